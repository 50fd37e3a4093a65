"""Functional mock-up units (FMI 2.0 and 3.0): a shaper, or a plant, for any simulator, without Python.

A unit holds the description of its variables, a library compiled here and its sources, for other machines. It serves
co-simulation and model exchange.
"""

import io
import tempfile
import uuid
import zipfile
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from jshape import _check
from jshape.export.c99 import c99
from jshape.export.compiler import library, target
from jshape.export.text import TEMPLATES, fill
from jshape.shaper import Shaper

VERSIONS = ("2.0", "3.0")

OWN = ("core", "equations", "model")
"""Names of files of every unit; its own header has the unit's name."""


class Variable(NamedTuple):
    """A variable of a unit.

    Attributes:
        name: as simulators show it.
        causality: ``"input"``, ``"output"`` or ``"local"``.
        variability: ``"continuous"`` or ``"discrete"``.
        about: in words, with its unit.
        start: value before the initialisation; ``None`` where the unit computes it.
        boolean: whether it is a switch, else a real number.
        derivative_of: place of the state whose derivative it is, from 0 in the list of all variables.
    """

    name: str
    causality: str
    variability: str
    about: str
    start: float | bool | None = None
    boolean: bool = False
    derivative_of: int | None = None


def shaper_unit(
    shaper: Shaper,
    *,
    sample_time: float,
    method: str = "nearest",
    modes: Sequence[tuple[float, float]] = (),
    name: str = "shaper",
    fmi: str = "2.0",
) -> bytes:
    """A unit that shapes ``command`` into ``shaped`` once every sample time, from the C header's filter in double.

    In co-simulation a step takes the samples from its beginning on with the command that is set then: after a step from
    t to t + sample_time the output is the sample of t. In model exchange each sample is a time event. At the
    initialisation the filter is at rest at the command; ``bypass`` lets the command through without a jump.

    Args:
        shaper: the shaper.
        sample_time: s.
        method: as in ``Shaper.digitise``.
        modes: likewise.
        name: of the unit.
        fmi: ``"2.0"`` or ``"3.0"``.

    Raises:
        ValueError: as ``c99``, and where there is no C compiler.
    """
    header = c99(shaper, sample_time=sample_time, method=method, modes=modes, name=name, arithmetic="double")
    variables = [
        Variable("command", "input", "continuous", "what is to be shaped, in any unit", 0.0),
        Variable("shaped", "output", "discrete", "the shaped command, in the same unit"),
        Variable("bypass", "input", "discrete", "the command goes through unshaped", False, boolean=True),
    ]
    sources = {f"{name}.h": header, "equations.h": fill("fmu/shaper_equations.h", name=name, NAME=name.upper())}
    own = f'#include "{name}.h"\ntypedef {name}_state Own;\n'
    return unit(name, variables, 1, 0, own, sources, fmi, float(sample_time))


def unit(
    name: str,
    variables: list[Variable],
    settable: int,
    states: int,
    own: str,
    sources: dict[str, str],
    fmi: str = "2.0",
    step: float | None = None,
) -> bytes:
    """A unit as the bytes of its file.

    Args:
        name: of the unit, an identifier of C.
        variables: the real ones first, in the order of their value references; those that may be set first of all.
        settable: how many those are.
        states: how many of them, the last ones, are continuous states.
        own: C that declares the type ``Own``.
        sources: further files of C by their names.
        fmi: ``"2.0"`` or ``"3.0"``.
        step: communication step that is suggested, s.

    Raises:
        ValueError: for an unknown version, a name that a file of every unit has, and where there is no C compiler.
    """
    _check.one_of(fmi, "fmi", VERSIONS)
    if name.lower() in OWN:
        raise ValueError(f"name must not be {name!r}, which a file of every unit is called")
    reals = sum(not variable.boolean for variable in variables)
    numbers = {
        "N_REAL": reals,
        "N_BOOLEAN": len(variables) - reals,
        "N_SETTABLE": settable,
        "N_STATE": states,
        "FIRST_STATE": settable - states,
    }
    main = f"fmi{fmi[0]}.c"
    files = {**sources, **{file: (TEMPLATES / "fmu" / file).read_text(encoding="utf-8") for file in ("core.h", main)}}
    token = str(uuid.uuid5(uuid.NAMESPACE_URL, repr((fmi, numbers, own, variables, sorted(files.items())))))
    token = f"{{{token}}}"
    defined = "".join(f"#define {key} {value}\n" for key, value in numbers.items())
    files["model.h"] = f'#define MODEL_TOKEN "{token}"\n{defined}{own}'
    with tempfile.TemporaryDirectory() as folder:
        for file, text in files.items():
            (Path(folder) / file).write_text(text, encoding="utf-8")
        built = library(Path(folder), main, name)
    machine, system, ending = target()
    described = _described2 if fmi == "2.0" else _described3
    content = {"modelDescription.xml": _xml(described(name, token, variables, states, main, step))}
    content[f"binaries/{_platform(fmi, machine, system)}/{name}{ending}"] = built
    content |= {f"sources/{file}": text.encode() for file, text in sorted(files.items())}
    if fmi == "3.0":
        content["sources/buildDescription.xml"] = _xml(_build_description(name, main))
    return _zipped(content)


def _zipped(content: dict[str, bytes]) -> bytes:
    """Files in an archive whose bytes depend on nothing else."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for path, data in content.items():
            info = zipfile.ZipInfo(path)
            info.compress_type, info.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            archive.writestr(info, data)
    return buffer.getvalue()


def _platform(fmi: str, machine: str, system: str) -> str:
    """The folder of a library, as the version of the interface names it."""
    if fmi == "3.0":
        return f"{machine}-{system}"
    return {"linux": "linux", "darwin": "darwin", "windows": "win"}[system] + "64"


def _xml(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _text(value: float | bool) -> str:
    return str(value).lower() if isinstance(value, bool) else repr(float(value))


def _root(name: str, fmi: str, token: str) -> ElementTree.Element:
    attributes = {"fmiVersion": fmi, "modelName": name, "generationTool": f"jshape {version('jshape')}"}
    attributes["guid" if fmi == "2.0" else "instantiationToken"] = token
    return ElementTree.Element("fmiModelDescription", attributes | {"variableNamingConvention": "structured"})


def _described2(
    name: str, token: str, variables: list[Variable], states: int, main: str, step: float | None
) -> ElementTree.Element:
    """``modelDescription.xml`` of FMI 2.0."""
    root, add = _root(name, "2.0", token), ElementTree.SubElement
    root.set("numberOfEventIndicators", "0")
    common = {"modelIdentifier": name, "canGetAndSetFMUstate": "true"}
    for kind in ("ModelExchange", "CoSimulation"):
        variable_steps = {"canHandleVariableCommunicationStepSize": "true"} if kind == "CoSimulation" else {}
        add(add(add(root, kind, common | variable_steps), "SourceFiles"), "File", name=main)
    add(root, "DefaultExperiment", {"startTime": "0.0"} | ({} if step is None else {"stepSize": repr(step)}))
    listed, places = add(root, "ModelVariables"), {}
    counts = {True: 0, False: 0}
    for index, variable in enumerate(variables, 1):
        attributes = _attributes(variable, str(counts[variable.boolean]))
        counts[variable.boolean] += 1
        value = {} if variable.start is None else {"start": _text(variable.start)}
        if variable.derivative_of is not None:
            value["derivative"] = str(variable.derivative_of + 1)
        add(add(listed, "ScalarVariable", attributes), "Boolean" if variable.boolean else "Real", value)
        places.setdefault("output" if variable.causality == "output" else "", []).append(index)
    structure = add(root, "ModelStructure")
    derivatives = [i for i, variable in enumerate(variables, 1) if variable.derivative_of is not None]
    computed = [i for i in places.get("output", []) if variables[i - 1].start is None]
    for kind, found in (
        ("Outputs", places.get("output", [])),
        ("Derivatives", derivatives),
        ("InitialUnknowns", sorted({*computed, *derivatives})),
    ):
        if found:
            group = add(structure, kind)
            for index in found:
                add(group, "Unknown", index=str(index))
    return root


def _attributes(variable: Variable, reference: str) -> dict[str, str]:
    """What both versions say of a variable."""
    found = {"name": variable.name, "valueReference": reference, "description": variable.about}
    found |= {"causality": variable.causality, "variability": variable.variability}
    if variable.causality != "input":
        found["initial"] = "calculated" if variable.start is None else "exact"
    return found


def _described3(
    name: str, token: str, variables: list[Variable], states: int, main: str, step: float | None
) -> ElementTree.Element:
    """``modelDescription.xml`` of FMI 3.0."""
    root, add = _root(name, "3.0", token), ElementTree.SubElement
    common = {"modelIdentifier": name, "canGetAndSetFMUState": "true"}
    add(root, "ModelExchange", common)
    add(root, "CoSimulation", common | {"canHandleVariableCommunicationStepSize": "true"})
    add(root, "DefaultExperiment", {"startTime": "0.0"} | ({} if step is None else {"stepSize": repr(step)}))
    listed = add(root, "ModelVariables")
    reference = {variable.name: str(i) for i, variable in enumerate(variables, 1)}
    add(
        listed, "Float64", name="time", valueReference="0", causality="independent", variability="continuous",
        description="s",
    )  # fmt: skip
    for variable in variables:
        attributes = _attributes(variable, reference[variable.name])
        if variable.start is not None:
            attributes["start"] = _text(variable.start)
        if variable.derivative_of is not None:
            attributes["derivative"] = reference[variables[variable.derivative_of].name]
        add(listed, "Boolean" if variable.boolean else "Float64", attributes)
    structure = add(root, "ModelStructure")
    outputs = [variable for variable in variables if variable.causality == "output"]
    derivatives = [variable for variable in variables if variable.derivative_of is not None]
    computed = [*(variable for variable in outputs if variable.start is None), *derivatives]
    unknowns = {"Output": outputs, "ContinuousStateDerivative": derivatives, "InitialUnknown": computed}
    for kind, some in unknowns.items():
        for variable in some:
            add(structure, kind, valueReference=reference[variable.name])
    return root


def _build_description(name: str, main: str) -> ElementTree.Element:
    """What FMI 3.0 says of the sources."""
    root = ElementTree.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ElementTree.SubElement(root, "BuildConfiguration", modelIdentifier=name)
    files = ElementTree.SubElement(configuration, "SourceFileSet", language="C99")
    ElementTree.SubElement(files, "SourceFile", name=main)
    return root
