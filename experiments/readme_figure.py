"""The README's picture: a payload that may weigh 20 % more or less, moved by three shapers. Run: python FILE OUT.svg"""

import sys

import jax
import jax.numpy as jnp
import matplotlib as mpl

import jshape as js
from jshape.reports import plot
from jshape.sweeps.leaves import with_leaves


def main(path: str) -> None:
    jax.config.update("jax_enable_x64", True)
    mpl.use("svg")
    # Text stays text, and the same picture gives the same file.
    mpl.rcParams.update({"svg.hashsalt": "jshape", "svg.fonttype": "none"})
    plant = js.plants.TwoMass(m1=1.0, m2=1.0, spring=js.plants.Duffing(k1=10.0, k3=100.0))
    three = js.design.energy.three_impulse(plant, 1.0)
    over = {"m2": jnp.linspace(0.8, 1.2, 41)}
    tuned = js.tune(plant, 1.0, impulses=3, duration=float(three.duration), over=over, objective="worst")
    shapers = {
        "two impulses by energy, 0.59 s": js.design.energy.two_impulse(plant, 1.0),
        "three impulses by energy, 1.64 s": three,
        "three impulses, tuned for the worst case, 1.64 s": tuned.shaper,
    }

    def run(plant, shaper):
        return js.simulate(plant, 1.0, shaper.pad(3), horizon=4.0, samples=161)

    ends = [with_leaves(plant, {"m2": m2}) for m2 in (0.8, 1.2)]
    nominal = {name: run(plant, shaper) for name, shaper in shapers.items()}
    extremes = {name: [run(end, shaper) for end in ends] for name, shaper in shapers.items()}
    axes = plot.response(nominal, extremes, ("base", "payload"))
    axes[0, 0].figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    main(sys.argv[1])
