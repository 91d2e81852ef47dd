"""The functions of FMI 2.0."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from piezo_opt.export.c.plan import Plan
from piezo_opt.export.fmu.text import shared
from piezo_opt.export.fmu.variables import INPUT, RATE, STATE, Variable

_TYPES: Final = """
#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Char;
typedef const fmi2Char *fmi2String;
typedef char fmi2Byte;
typedef unsigned int fmi2ValueReference;
typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;
typedef struct {
    fmi2Boolean newDiscreteStatesNeeded, terminateSimulation, nominalsOfContinuousStatesChanged,
        valuesOfContinuousStatesChanged, nextEventTimeDefined;
    fmi2Real nextEventTime;
} fmi2EventInfo;

typedef fmi2Component C;
typedef const fmi2ValueReference *V;
"""

_COMMON: Final = """
EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid,
    fmi2String resources, const fmi2CallbackFunctions *functions, fmi2Boolean visible,
    fmi2Boolean logging)
{
    unit *m;
    (void)name; (void)resources; (void)functions; (void)visible; (void)logging;
    if (type != KIND || !guid || strcmp(guid, TOKEN) != 0) return NULL;
    m = (unit *)malloc(sizeof *m);
    if (m) restart(m);
    return m;
}

EXPORT void fmi2FreeInstance(C c) { free(c); }

EXPORT fmi2Status fmi2SetDebugLogging(C c, fmi2Boolean on, size_t n, const fmi2String names[])
{
    (void)c; (void)on; (void)n; (void)names;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetupExperiment(C c, fmi2Boolean tolerant, fmi2Real tolerance,
    fmi2Real start, fmi2Boolean ends, fmi2Real stop)
{
    (void)tolerant; (void)tolerance; (void)ends; (void)stop;
    ((unit *)c)->begun = start;
    return fmi2OK;
}

EXPORT fmi2Status fmi2EnterInitializationMode(C c)
{
    ((unit *)c)->initialising = 1;
    return fmi2OK;
}

EXPORT fmi2Status fmi2ExitInitializationMode(C c)
{
    rest((unit *)c);
    ((unit *)c)->initialising = 0;
    return fmi2OK;
}

EXPORT fmi2Status fmi2Terminate(C c) { (void)c; return fmi2OK; }
EXPORT fmi2Status fmi2Reset(C c) { restart((unit *)c); return fmi2OK; }

EXPORT fmi2Status fmi2GetReal(C c, V r, size_t n, fmi2Real values[])
{
    size_t i;
    unit *m = (unit *)c;
    if (m->initialising) rest(m);
    for (i = 0; i < n; ++i) if (!get(m, r[i], &values[i])) return fmi2Error;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetReal(C c, V r, size_t n, const fmi2Real values[])
{
    size_t i;
    for (i = 0; i < n; ++i) if (!set((unit *)c, r[i], values[i])) return fmi2Error;
    return fmi2OK;
}

/* There are no variables of other types. */
#define NONE(what, type) \\
    EXPORT fmi2Status fmi2##what(C c, V r, size_t n, type values[]) \\
    { (void)c; (void)r; (void)values; return n ? fmi2Error : fmi2OK; }
NONE(GetInteger, fmi2Integer)
NONE(GetBoolean, fmi2Boolean)
NONE(GetString, fmi2String)
NONE(SetInteger, const fmi2Integer)
NONE(SetBoolean, const fmi2Boolean)
NONE(SetString, const fmi2String)

/* The state of a unit is the whole of it. */
EXPORT fmi2Status fmi2GetFMUstate(C c, fmi2FMUstate *state)
{
    if (!*state) *state = malloc(sizeof(unit));
    if (!*state) return fmi2Error;
    memcpy(*state, c, sizeof(unit));
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetFMUstate(C c, fmi2FMUstate state)
{
    memcpy(c, state, sizeof(unit));
    return fmi2OK;
}

EXPORT fmi2Status fmi2FreeFMUstate(C c, fmi2FMUstate *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializedFMUstateSize(C c, fmi2FMUstate state, size_t *size)
{
    (void)c; (void)state;
    *size = sizeof(unit);
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializeFMUstate(C c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    (void)c;
    if (size < sizeof(unit)) return fmi2Error;
    memcpy(bytes, state, sizeof(unit));
    return fmi2OK;
}

EXPORT fmi2Status fmi2DeSerializeFMUstate(C c, const fmi2Byte bytes[], size_t size,
    fmi2FMUstate *state)
{
    (void)c;
    if (size != sizeof(unit)) return fmi2Error;
    if (!*state) *state = malloc(sizeof(unit));
    if (!*state) return fmi2Error;
    memcpy(*state, bytes, sizeof(unit));
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetDirectionalDerivative(C c, V of, size_t n, V by, size_t k,
    const fmi2Real seed[], fmi2Real values[])
{
    (void)c; (void)of; (void)n; (void)by; (void)k; (void)seed; (void)values;
    return fmi2Error;
}
"""

_SIMULATION: Final = """
EXPORT fmi2Status fmi2SetRealInputDerivatives(C c, V r, size_t n, const fmi2Integer order[],
    const fmi2Real values[])
{
    size_t i;
    unit *m = (unit *)c;
    for (i = 0; i < n; ++i) {
        if (order[i] != 1) return fmi2Error;
        switch (r[i]) {
@INPUTS@
        default: return fmi2Error;
        }
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetRealOutputDerivatives(C c, V r, size_t n, const fmi2Integer order[],
    fmi2Real values[])
{
    (void)c; (void)r; (void)order; (void)values;
    return n ? fmi2Error : fmi2OK;
}

EXPORT fmi2Status fmi2DoStep(C c, fmi2Real now, fmi2Real h, fmi2Boolean final)
{
    (void)now; (void)final;
    if (!(h >= 0.0)) return fmi2Error;
    pass((unit *)c, h);
    return fmi2OK;
}

EXPORT fmi2Status fmi2CancelStep(C c) { (void)c; return fmi2Error; }
#define STATUS(what, type) \\
    EXPORT fmi2Status fmi2Get##what(C c, int kind, type *value) \\
    { (void)c; (void)kind; (void)value; return fmi2Discard; }
STATUS(Status, fmi2Status)
STATUS(RealStatus, fmi2Real)
STATUS(IntegerStatus, fmi2Integer)
STATUS(BooleanStatus, fmi2Boolean)
STATUS(StringStatus, fmi2String)
"""

_EXCHANGE: Final = """
EXPORT fmi2Status fmi2EnterEventMode(C c) { (void)c; return fmi2OK; }
EXPORT fmi2Status fmi2EnterContinuousTimeMode(C c) { (void)c; return fmi2OK; }

EXPORT fmi2Status fmi2NewDiscreteStates(C c, fmi2EventInfo *info)
{
    (void)c;
    memset(info, 0, sizeof *info);
    return fmi2OK;
}

EXPORT fmi2Status fmi2CompletedIntegratorStep(C c, fmi2Boolean final, fmi2Boolean *event,
    fmi2Boolean *end)
{
    (void)c; (void)final;
    *event = 0;
    *end = 0;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetTime(C c, fmi2Real time)
{
    @TIME@
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetContinuousStates(C c, fmi2Real x[], size_t n)
{
    if (n != @COUNT@) return fmi2Error;
@READ@
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetContinuousStates(C c, const fmi2Real x[], size_t n)
{
    if (n != @COUNT@) return fmi2Error;
@WRITE@
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetDerivatives(C c, fmi2Real dx[], size_t n)
{
    @RATES@
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetEventIndicators(C c, fmi2Real z[], size_t n)
{
    (void)c; (void)z;
    return n ? fmi2Error : fmi2OK;
}

EXPORT fmi2Status fmi2GetNominalsOfContinuousStates(C c, fmi2Real x[], size_t n)
{
    size_t i;
    (void)c;
    for (i = 0; i < n; ++i) x[i] = 1.0;
    return fmi2OK;
}
"""


def source(plan: Plan, variables: Sequence[Variable], token: str, exchange: bool) -> str:
    """The C text of a unit for FMI 2.0, which includes that of the model."""
    kind = "fmi2ModelExchange" if exchange else "fmi2CoSimulation"
    text = shared(plan, variables, token, exchange) + _TYPES + f"\n#define KIND {kind}\n" + _COMMON
    if not exchange:
        inputs = [v for v in variables if v.role == INPUT]
        cases = "\n".join(
            f"        case {v.reference}: m->rate.{name} = values[i]; m->rated.{name} = 1; break;"
            for v, name in zip(inputs, (plan.input, *plan.channels), strict=True)
        )
        return text + _SIMULATION.replace("@INPUTS@", cases)
    states = [v for v in variables if v.role == STATE]
    rates = [v for v in variables if v.role == RATE]
    count = len(rates)
    given = [v for v in states if v.reference in {r.of for r in rates}]
    read = "\n".join(f"    x[{i}] = ((unit *)c)->{v.place};" for i, v in enumerate(given))
    write = "\n".join(f"    ((unit *)c)->{v.place} = x[{i}];" for i, v in enumerate(given))
    told = "\n".join(f"    dx[{i}] = {v.place};" for i, v in enumerate(rates))
    got = f"{plan.prefix}_rates k;\n    if (n != {count}) return fmi2Error;\n"
    got += f"    rates_now((unit *)c, &k);\n{told}"
    time = (
        "((unit *)c)->one.time = time - ((unit *)c)->begun;" if plan.timed
        else "(void)c; (void)time;"
    )  # fmt: skip
    wanted = _EXCHANGE
    for key, value in (
        ("TIME", time), ("COUNT", str(count)), ("READ", read or "    (void)c; (void)x;"),
        ("WRITE", write or "    (void)c; (void)x;"),
        ("RATES", got if count else "(void)c; (void)dx; (void)n;"),
    ):  # fmt: skip
        wanted = wanted.replace(f"@{key}@", value)
    return text + wanted
