"""modelDescription.xml of both versions."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from xml.sax.saxutils import quoteattr

from piezo_opt.export.c import naming
from piezo_opt.export.c.plan import Plan
from piezo_opt.export.fmu.units import exponents
from piezo_opt.export.fmu.variables import INPUT, OUTPUT, PARAMETER, RATE, STATE, Variable

_TOOL = f"piezo_opt {version('piezo_opt')}"


def fmi2(plan: Plan, variables: Sequence[Variable], token: str, exchange: bool, step: float) -> str:
    """For FMI 2.0."""
    name = plan.prefix
    kind = (
        f'  <ModelExchange modelIdentifier="{name}" canGetAndSetFMUstate="true" '
        'canSerializeFMUstate="true">' if exchange else
        f'  <CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true" '
        'canInterpolateInputs="true" maxOutputDerivativeOrder="0" canGetAndSetFMUstate="true" '
        'canSerializeFMUstate="true">'
    )  # fmt: skip
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{token}" '
        f"description={_quoted(_words(plan))} generationTool={_quoted(_TOOL)} "
        'variableNamingConvention="flat" numberOfEventIndicators="0">',
        kind,
        '    <SourceFiles><File name="fmi2.c"/></SourceFiles>',
        f"  </{'ModelExchange' if exchange else 'CoSimulation'}>",
        *_units(variables, "BaseUnit"),
        f'  <DefaultExperiment startTime="0" stopTime="{1000 * step!r}" stepSize="{step!r}"/>',
        "  <ModelVariables>",
    ]
    for v in variables:
        head = (
            f'    <ScalarVariable name={_quoted(v.name)} valueReference="{v.reference}" '
            f"description={_quoted(v.meaning)} {_character(v, 'local')}>"
        )
        start = "" if v.start is None else f' start="{v.start!r}"'
        of = f' derivative="{v.of}"' if v.role == RATE else ""
        lines += [head, f"      <Real unit={_quoted(v.unit)}{start}{of}/>", "    </ScalarVariable>"]
    lines += ["  </ModelVariables>", "  <ModelStructure>", "    <Outputs>"]
    # Indices count from one, as references do.
    lines += [f'      <Unknown index="{v.reference}"/>' for v in variables if v.role == OUTPUT]
    lines += ["    </Outputs>"]
    rates = [v for v in variables if v.role == RATE]
    if rates:
        lines += ["    <Derivatives>"]
        lines += [f'      <Unknown index="{v.reference}"/>' for v in rates]
        lines += ["    </Derivatives>"]
    unknown = [v for v in variables if v.role in (OUTPUT, RATE) or (v.role == STATE and exchange)]
    lines += ["    <InitialUnknowns>"]
    lines += [f'      <Unknown index="{v.reference}"/>' for v in unknown]
    lines += ["    </InitialUnknowns>", "  </ModelStructure>", "</fmiModelDescription>", ""]
    return "\n".join(lines)


def fmi3(plan: Plan, variables: Sequence[Variable], token: str, step: float) -> str:
    """For FMI 3.0."""
    name = plan.prefix
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<fmiModelDescription fmiVersion="3.0" modelName="{name}" instantiationToken="{token}" '
        f"description={_quoted(_words(plan))} generationTool={_quoted(_TOOL)} "
        'variableNamingConvention="flat">',
        f'  <CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true" '
        'canGetAndSetFMUState="true" canSerializeFMUState="true"/>',
        *_units(variables, "BaseUnit"),
        f'  <DefaultExperiment startTime="0" stopTime="{1000 * step!r}" stepSize="{step!r}"/>',
        "  <ModelVariables>",
        '    <Float64 name="time" valueReference="0" causality="independent" '
        'variability="continuous" unit="s"/>',
    ]
    for v in variables:
        start = "" if v.start is None else f' start="{v.start!r}"'
        lines.append(
            f'    <Float64 name={_quoted(v.name)} valueReference="{v.reference}" '
            f"description={_quoted(v.meaning)} {_character(v, 'local')} "
            f"unit={_quoted(v.unit)}{start}/>"
        )
    output = next(v.reference for v in variables if v.role == OUTPUT)
    lines += [
        "  </ModelVariables>",
        "  <ModelStructure>",
        f'    <Output valueReference="{output}"/>',
        f'    <InitialUnknown valueReference="{output}"/>',
        "  </ModelStructure>",
        "</fmiModelDescription>",
        "",
    ]
    return "\n".join(lines)


def build_description(plan: Plan) -> str:
    """sources/buildDescription.xml of FMI 3.0."""
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<fmiBuildDescription fmiVersion="3.0">\n'
        f'  <BuildConfiguration modelIdentifier="{plan.prefix}">\n'
        '    <SourceFileSet language="C99"><SourceFile name="fmi3.c"/></SourceFileSet>\n'
        "  </BuildConfiguration>\n</fmiBuildDescription>\n"
    )


def _character(v: Variable, state: str) -> str:
    if v.role == PARAMETER:
        return 'causality="parameter" variability="tunable" initial="exact"'
    if v.role == INPUT:
        return 'causality="input" variability="continuous"'
    if v.role == OUTPUT:
        return 'causality="output" variability="continuous" initial="calculated"'
    return f'causality="{state}" variability="continuous" initial="calculated"'


def _units(variables: Sequence[Variable], base: str) -> list[str]:
    lines = ["  <UnitDefinitions>"]
    for unit in sorted({v.unit for v in variables} | {"s"}):
        powers = " ".join(f'{name}="{power}"' for name, power in exponents(unit).items())
        lines.append(
            f"    <Unit name={_quoted(unit)}><{base} {powers}/></Unit>".replace(" />", "/>")
        )
    return [*lines, "  </UnitDefinitions>"]


def _words(plan: Plan) -> str:
    return naming.plain(f"{' + '.join(plan.given.model.names)}, from {plan.given.told}")


def _quoted(text: str) -> str:
    return quoteattr(naming.plain(text))
