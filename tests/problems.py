"""One table of exact answers that drives the parametrised tests.

Each was computed apart from jshape: closed forms, quadrature, roots of runs at tight tolerance. Where a paper prints
another number, the row says which and why. The plant has m1 = m2 = 1 kg, k1 = 10 N/m, k3 = 100 N/m³ (k2 in the first
paper) and moves by 1 m, unless a row says otherwise.
"""

import dataclasses

import numpy as np

import jshape as js


@dataclasses.dataclass(frozen=True)
class Answer:
    """An exact answer: ``value`` (one number or several) within ``tolerance``, absolute; ``printed``: in the paper."""

    id: str
    what: str
    value: float | tuple[float, ...]
    tolerance: float
    printed: float | tuple[float, ...] | None = None
    note: str = ""

    def check(self, computed) -> None:
        """Fails unless ``computed`` is the answer."""
        message = f"{self.id}: {self.what}"
        np.testing.assert_allclose(computed, self.value, rtol=0.0, atol=self.tolerance, err_msg=message)


_ROWS = [
    # Chatlatanagulchai, Moonmangmee and Intarawirat (2017).
    Answer("000.t2", "two-impulse t2 (s)", 0.591240537428156, 1e-09, printed=0.5912),
    Answer("000.A1", "two-impulse A1", 0.5, 1e-09, printed=0.5),
    Answer(
        "000.damped.A1",
        "c = 0.1: A1 for which the payload just reaches 1 m",
        0.5256241522156421,
        1e-08,
        printed=0.525,
        note="found by trial and error in the paper; 0.5256 rounds to 0.526",
    ),
    Answer(
        "000.damped.t2",
        "c = 0.1: t2 for that A1 (s)",
        0.593155079806033,
        1e-08,
        printed=0.5935,
        note="printed 0.5935 belongs to A1 = 0.525",
    ),
    Answer(
        "000.damped.t2_at_.525",
        "c = 0.1: time of the highest point for A1 = 0.525 (s)",
        0.5935484262208597,
        1e-08,
        printed=0.5935,
    ),
    Answer(
        "000.damped.x2max_at_.525",
        "c = 0.1: the highest point for A1 = 0.525 (m)",
        0.9989337475191766,
        1e-08,
        printed=1.0,
        note="0.11 % short of the destination",
    ),
    Answer("000.dissip.exact", "c = 0.1: energy lost in the swing (J)", 0.8985278021476644, 1e-08),
    Answer(
        "000.dissip.integral",
        "c = 0.1: loss in a harmonic quarter cycle, 3π/16 c x_d⁴ ω³ with ω = π/t2 (J)",
        8.837067119554517,
        1e-08,
        printed=4.187566466972623,
        note='the printed antiderivative is dimensionally wrong; "printed" is its value',
    ),
    Answer(
        "000.dissip.A1",
        "c = 0.1: A1 from the harmonic quarter cycle, the printed loss, a half cycle of x_d/2, the undamped orbit",
        (0.7214565184797859, 0.6152688515129311, 0.5314718903576302, 0.5256783331418132),
        1e-07,
        note="the exact A1 is 0.5256241522: only the orbit comes near",
    ),
    Answer("000.neg.t2", "negative shaper t2 (s)", 0.10791264653894031, 1e-09, printed=0.1079),
    Answer("000.neg.t3", "negative shaper t3 (s)", 0.21582529307788062, 1e-09, printed=0.2158),
    Answer(
        "000.flex",
        "flexible joint: normalised amplitudes from 27.58° of 39.25°",
        (0.7026751592356687, 0.2973248407643312),
        1e-09,
        printed=(0.703, 0.297),
    ),
    Answer(
        "000.robust.n2",
        "2 impulses, m2 + 20 %: duration (s), overshoot (m), residual energy (J)",
        (0.591240537428156, 0.24237368430050263, 0.37999939817790007),
        1e-09,
    ),
    Answer(
        "000.robust.n3",
        "3 impulses, m2 + 20 %: duration (s), overshoot (m), residual energy (J)",
        (1.6429799430793326, 0.024495840893780457, 0.003009232492153247),
        1e-09,
        note="fewer is better here than one more: equal steps are first-order robust for odd n only",
    ),
    Answer(
        "000.robust.n4",
        "4 impulses, m2 + 20 %: duration (s), overshoot (m), residual energy (J)",
        (2.712983249313603, 0.0589365851662395, 0.017669239071064005),
        1e-09,
    ),
    Answer(
        "000.robust.n5",
        "5 impulses, m2 + 20 %: duration (s), overshoot (m), residual energy (J)",
        (3.7605073176187207, 0.018223134736933468, 0.00166317017019092),
        1e-09,
        note="fewer is better here than one more: equal steps are first-order robust for odd n only",
    ),
    Answer(
        "000.robust.n6",
        "6 impulses, m2 + 20 %: duration (s), overshoot (m), residual energy (J)",
        (4.791369851307396, 0.02919848264923461, 0.004280928041861171),
        1e-09,
    ),
    Answer(
        "000.robust.n7",
        "7 impulses, m2 + 20 %: duration (s), overshoot (m), residual energy (J)",
        (5.811633643830384, 0.01629855506120074, 0.0013299786391342276),
        1e-09,
    ),
    Answer(
        "000.robust.n8",
        "8 impulses, m2 + 20 %: duration (s), overshoot (m), residual energy (J)",
        (6.825053059341348, 0.01570214355589634, 0.0012343063239554832),
        1e-09,
    ),
    # Moonmangmee and Chatlatanagulchai (2025), the same plant.
    Answer(
        "001.tab1.0.45",
        "Table 1, α = 0.45: t2, t3 (s)",
        (0.8471247318706183, 1.6428852345218599),
        1e-09,
        printed=(0.847, 1.643),
    ),
    Answer(
        "001.tab1.0.50",
        "Table 1, α = 0.50: t2, t3 (s)",
        (0.8214899715396663, 1.6429799430793326),
        1e-09,
        printed=(0.822, 1.643),
        note="0.822 is half of the rounded 1.643",
    ),
    Answer(
        "001.tab1.0.55",
        "Table 1, α = 0.55: t2, t3 (s)",
        (0.7957605026512415, 1.6428852345218599),
        1e-09,
        printed=(0.796, 1.643),
    ),
    Answer("001.tab1.1.00", "Table 1, α = 1: t2 (s)", 0.591240537428156, 1e-09, printed=0.591),
    Answer(
        "001.tab2.lin",
        "Table 2, linear ZVD: t2, t3 (s)",
        (0.9934588265796102, 1.9869176531592203),
        1e-09,
        printed=(0.994, 1.987),
        note="0.994 should be 0.993",
    ),
    Answer(
        "001.tab2.4imp",
        "Table 2, 4 impulses: t2 … t4 (s)",
        (0.904327749771201, 1.808655499542402, 2.712983249313603),
        1e-09,
        printed=(0.904, 1.809, 2.713),
    ),
    Answer(
        "001.tab2.5imp",
        "5 impulses: t2 … t5 (s)",
        (0.9401268294046802, 1.8802536588093604, 2.8203804882140404, 3.7605073176187207),
        1e-09,
    ),
    Answer(
        "001.tab2.6imp",
        "6 impulses: t2 … t6 (s)",
        (0.9582739702614791, 1.9165479405229582, 2.8748219107844375, 3.8330958810459164, 4.791369851307396),
        1e-09,
    ),
    Answer("001.fast.A", "fast three-impulse shaper: A1 = A2", 0.30423566977577476, 1e-09, printed=0.3042),
    Answer(
        "001.fast.A3",
        "fast three-impulse shaper: A3",
        0.39152866044845047,
        1e-09,
        printed=0.3916,
        note="0.3916 is 1 − 2·0.3042",
    ),
    Answer(
        "001.fast.t",
        "fast three-impulse shaper: t2, t3 (s)",
        (0.3829748360968695, 0.9263295685256799),
        1e-09,
        printed=(0.383, 0.926),
    ),
    Answer(
        "001.energy",
        "total energy of a swing with k = 0 … 4 rests (J)",
        (2.8125, 0.41015625, 0.15817901234567902, 0.084228515625, 0.0525),
        1e-09,
    ),
    Answer(
        "001.energy.ratios",
        "ratios of the first four of those",
        (6.857142857142857, 2.5929878048780486, 1.8779745929504383),
        1e-09,
        printed=(6.7, 2.6, 1.9),
        note="6.857, not 6.7",
    ),
    Answer(
        "001.rise.2", "2 impulses: rise time from 10 % to 90 %, first arrival (s)", (0.3684444736, 0.5912405374), 1e-08
    ),
    Answer(
        "001.rise.fast3",
        "fast three-impulse: rise time from 10 % to 90 %, first arrival (s)",
        (0.5821774988, 0.9263295685),
        1e-08,
    ),
    Answer(
        "001.rise.3", "3 impulses: rise time from 10 % to 90 %, first arrival (s)", (1.1715658182, 1.6429799431), 1e-08
    ),
    Answer(
        "001.rise.ZVDlin",
        "linear ZVD: rise time from 10 % to 90 %, first arrival (s)",
        (1.332861014, 1.6585347287),
        1e-08,
    ),
    Answer(
        "001.rise.4", "4 impulses: rise time from 10 % to 90 %, first arrival (s)", (2.0517315756, 2.7129832493), 1e-08
    ),
    Answer(
        "001.rise.5", "5 impulses: rise time from 10 % to 90 %, first arrival (s)", (2.9429700336, 3.7605073176), 1e-08
    ),
    Answer(
        "001.rise.6", "6 impulses: rise time from 10 % to 90 %, first arrival (s)", (3.833095881, 4.7913698514), 1e-08
    ),
    Answer(
        "001.prv.m2|0.6|2",
        "2 impulses, m2 × 0.6: residual amplitude over distance, residual energy (J)",
        (0.48353238197273857, 2.5356204904245105),
        1e-09,
    ),
    Answer(
        "001.prv.m2|0.6|3",
        "3 impulses, m2 × 0.6: residual amplitude over distance, residual energy (J)",
        (0.39684607495409385, 1.4074863971345497),
        1e-09,
    ),
    Answer(
        "001.prv.m2|0.6|4",
        "4 impulses, m2 × 0.6: residual amplitude over distance, residual energy (J)",
        (0.21267638601564992, 0.2773028643311145),
        1e-09,
    ),
    Answer(
        "001.prv.m2|0.8|2",
        "2 impulses, m2 × 0.8: residual amplitude over distance, residual energy (J)",
        (0.3014710630908722, 0.6609251897300579),
        1e-09,
    ),
    Answer(
        "001.prv.m2|0.8|3",
        "3 impulses, m2 × 0.8: residual amplitude over distance, residual energy (J)",
        (0.08915824651496251, 0.04132570631074358),
        1e-09,
    ),
    Answer(
        "001.prv.m2|0.8|4",
        "4 impulses, m2 × 0.8: residual amplitude over distance, residual energy (J)",
        (0.027946466968663486, 0.00392027430102962),
        1e-09,
    ),
    Answer(
        "001.prv.m2|1.2|2",
        "2 impulses, m2 × 1.2: residual amplitude over distance, residual energy (J)",
        (0.24237368430050263, 0.37999939817790007),
        1e-09,
    ),
    Answer(
        "001.prv.m2|1.2|3",
        "3 impulses, m2 × 1.2: residual amplitude over distance, residual energy (J)",
        (0.024495840893780457, 0.003009232492153247),
        1e-09,
    ),
    Answer(
        "001.prv.m2|1.2|4",
        "4 impulses, m2 × 1.2: residual amplitude over distance, residual energy (J)",
        (0.0589365851662395, 0.017669239071064005),
        1e-09,
    ),
    Answer(
        "001.prv.m2|1.4|2",
        "2 impulses, m2 × 1.4: residual amplitude over distance, residual energy (J)",
        (0.3577192876142094, 1.0491792455969233),
        1e-09,
    ),
    Answer(
        "001.prv.m2|1.4|3",
        "3 impulses, m2 × 1.4: residual amplitude over distance, residual energy (J)",
        (0.05765259019859831, 0.01689530046006536),
        1e-09,
    ),
    Answer(
        "001.prv.m2|1.4|4",
        "4 impulses, m2 × 1.4: residual amplitude over distance, residual energy (J)",
        (0.09157113561407798, 0.0436841844190764),
        1e-09,
    ),
    # Even numbers of impulses made robust to first order, which equal steps are not: steps s, 1 − 2s, s.
    Answer("first_order.A", "4 impulses", (0.134773520, 0.365226480, 0.365226480, 0.134773520), 1e-09),
    Answer("first_order.t", "4 impulses: t2 … t4 (s)", (0.932281453, 1.773840605, 2.706122059), 1e-09),
    Answer("first_order.s", "4 impulses: the first step", 0.269547039, 1e-09),
    # Closed forms.
    Answer(
        "ell.0.125", "half period of the Duffing mass at amplitude 0.125 m, 2 K(m)/Ω (s)", 0.9401268294046802, 1e-13
    ),
    Answer("ell.0.25", "half period of the Duffing mass at amplitude 0.25 m, 2 K(m)/Ω (s)", 0.8214899715396663, 1e-13),
    Answer("ell.0.5", "half period of the Duffing mass at amplitude 0.5 m, 2 K(m)/Ω (s)", 0.591240537428156, 1e-13),
    Answer("ell.1", "half period of the Duffing mass at amplitude 1 m, 2 K(m)/Ω (s)", 0.34655861190399684, 1e-13),
    Answer("ell.3", "half period of the Duffing mass at amplitude 3 m, 2 K(m)/Ω (s)", 0.12261717117210519, 1e-13),
    Answer(
        "lin.fast",
        "linear limit of the fast three-impulse shaper: A1 = 1 − 1/√2, t2 ω/π, t3 ω/π",
        (0.2928932188134525, 0.5, 1.25),
        1e-12,
    ),
    Answer("lin.neg", "linear limit of the negative shaper: t2 = π/(3ω) with ω = √10 (s)", 0.33115294219320335, 1e-12),
    # Chen, Yang, Ou and Yin (2009): m x'' + k x + a x³ = u with m = k = 1, rest to rest at x = 1 in two steps of force.
    Answer(
        "force.hardening",
        "a = 1: first and final force (N), time of the second (s)",
        (0.75, 2.0, 2.28551261512749),
        1e-12,
    ),
    Answer(
        "force.softening",
        "a = -0.2: first and final force (N), time of the second (s)",
        (0.45, 0.8, 3.49562029419135),
        1e-12,
    ),
]

ANSWERS = {row.id: row for row in _ROWS}


def ids(*beginnings: str) -> list[str]:
    """The ids that begin with one of these, in the order of the table: for ``parametrize``."""
    return [row.id for row in _ROWS if row.id.startswith(beginnings)]


def two_mass(m2=1.0, k1=10.0, k3=100.0, c=0.0):
    """The papers' plant, with the cubic damper of the first one's example."""
    return js.plants.TwoMass(1.0, m2, spring=js.plants.Duffing(k1, k3), damper=js.plants.PowerDamper(c, 3))
