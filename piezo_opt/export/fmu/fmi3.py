"""The functions of FMI 3.0, as far as co-simulation calls them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from piezo_opt.export.c.plan import Plan
from piezo_opt.export.fmu.text import shared
from piezo_opt.export.fmu.variables import Variable

_TEXT: Final = """
#include <stdbool.h>
#include <stdint.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef void *fmi3Instance;
typedef double fmi3Float64;
typedef bool fmi3Boolean;
typedef const char *fmi3String;
typedef uint8_t fmi3Byte;
typedef void *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef fmi3Instance C;
typedef const fmi3ValueReference *V;

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token,
    fmi3String resources, fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events,
    fmi3Boolean early, const fmi3ValueReference required[], size_t n, void *environment,
    void *log, void *intermediate)
{
    unit *m;
    (void)name; (void)resources; (void)visible; (void)logging; (void)events; (void)early;
    (void)required; (void)n; (void)environment; (void)log; (void)intermediate;
    if (!token || strcmp(token, TOKEN) != 0) return NULL;
    m = (unit *)malloc(sizeof *m);
    if (m) restart(m);
    return m;
}

EXPORT fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token,
    fmi3String resources, fmi3Boolean visible, fmi3Boolean logging, void *environment, void *log)
{
    (void)name; (void)token; (void)resources; (void)visible; (void)logging; (void)environment;
    (void)log;
    return NULL;
}

EXPORT fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token,
    fmi3String resources, fmi3Boolean visible, fmi3Boolean logging, void *environment, void *log,
    void *update, void *lock, void *unlock)
{
    (void)name; (void)token; (void)resources; (void)visible; (void)logging; (void)environment;
    (void)log; (void)update; (void)lock; (void)unlock;
    return NULL;
}

EXPORT void fmi3FreeInstance(C c) { free(c); }

EXPORT fmi3Status fmi3SetDebugLogging(C c, fmi3Boolean on, size_t n, const fmi3String names[])
{
    (void)c; (void)on; (void)n; (void)names;
    return fmi3OK;
}

EXPORT fmi3Status fmi3EnterInitializationMode(C c, fmi3Boolean tolerant, fmi3Float64 tolerance,
    fmi3Float64 start, fmi3Boolean ends, fmi3Float64 stop)
{
    (void)tolerant; (void)tolerance; (void)ends; (void)stop;
    ((unit *)c)->begun = start;
    ((unit *)c)->initialising = 1;
    return fmi3OK;
}

EXPORT fmi3Status fmi3ExitInitializationMode(C c)
{
    rest((unit *)c);
    ((unit *)c)->initialising = 0;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Terminate(C c) { (void)c; return fmi3OK; }
EXPORT fmi3Status fmi3Reset(C c) { restart((unit *)c); return fmi3OK; }

EXPORT fmi3Status fmi3GetFloat64(C c, V r, size_t n, fmi3Float64 values[], size_t k)
{
    size_t i;
    unit *m = (unit *)c;
    if (n != k) return fmi3Error;
    if (m->initialising) rest(m);
    for (i = 0; i < n; ++i) {
        if (r[i] == 0) values[i] = m->passed + m->begun;
        else if (!get(m, r[i], &values[i])) return fmi3Error;
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFloat64(C c, V r, size_t n, const fmi3Float64 values[], size_t k)
{
    size_t i;
    if (n != k) return fmi3Error;
    for (i = 0; i < n; ++i) if (!set((unit *)c, r[i], values[i])) return fmi3Error;
    return fmi3OK;
}

/* There are no variables of other types. */
#define NONE(what, type) \\
    EXPORT fmi3Status fmi3Get##what(C c, V r, size_t n, type values[], size_t k) \\
    { (void)c; (void)r; (void)values; (void)k; return n ? fmi3Error : fmi3OK; } \\
    EXPORT fmi3Status fmi3Set##what(C c, V r, size_t n, const type values[], size_t k) \\
    { (void)c; (void)r; (void)values; (void)k; return n ? fmi3Error : fmi3OK; }
NONE(Float32, float)
NONE(Int8, int8_t)
NONE(UInt8, uint8_t)
NONE(Int16, int16_t)
NONE(UInt16, uint16_t)
NONE(Int32, int32_t)
NONE(UInt32, uint32_t)
NONE(Int64, int64_t)
NONE(UInt64, uint64_t)
NONE(Boolean, fmi3Boolean)
NONE(String, fmi3String)
EXPORT fmi3Status fmi3GetBinary(C c, V r, size_t n, size_t sizes[], const fmi3Byte *values[],
    size_t k)
{ (void)c; (void)r; (void)sizes; (void)values; (void)k; return n ? fmi3Error : fmi3OK; }
EXPORT fmi3Status fmi3SetBinary(C c, V r, size_t n, const size_t sizes[],
    const fmi3Byte *const values[], size_t k)
{ (void)c; (void)r; (void)sizes; (void)values; (void)k; return n ? fmi3Error : fmi3OK; }
EXPORT fmi3Status fmi3GetClock(C c, V r, size_t n, bool values[])
{ (void)c; (void)r; (void)values; return n ? fmi3Error : fmi3OK; }
EXPORT fmi3Status fmi3SetClock(C c, V r, size_t n, const bool values[])
{ (void)c; (void)r; (void)values; return n ? fmi3Error : fmi3OK; }

/* The state of a unit is the whole of it. */
EXPORT fmi3Status fmi3GetFMUState(C c, fmi3FMUState *state)
{
    if (!*state) *state = malloc(sizeof(unit));
    if (!*state) return fmi3Error;
    memcpy(*state, c, sizeof(unit));
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFMUState(C c, fmi3FMUState state)
{
    memcpy(c, state, sizeof(unit));
    return fmi3OK;
}

EXPORT fmi3Status fmi3FreeFMUState(C c, fmi3FMUState *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(C c, fmi3FMUState state, size_t *size)
{
    (void)c; (void)state;
    *size = sizeof(unit);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializeFMUState(C c, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    (void)c;
    if (size < sizeof(unit)) return fmi3Error;
    memcpy(bytes, state, sizeof(unit));
    return fmi3OK;
}

EXPORT fmi3Status fmi3DeserializeFMUState(C c, const fmi3Byte bytes[], size_t size,
    fmi3FMUState *state)
{
    (void)c;
    if (size != sizeof(unit)) return fmi3Error;
    if (!*state) *state = malloc(sizeof(unit));
    if (!*state) return fmi3Error;
    memcpy(*state, bytes, sizeof(unit));
    return fmi3OK;
}

EXPORT fmi3Status fmi3EnterStepMode(C c) { (void)c; return fmi3OK; }
EXPORT fmi3Status fmi3EnterEventMode(C c) { (void)c; return fmi3Error; }
EXPORT fmi3Status fmi3EnterConfigurationMode(C c) { (void)c; return fmi3OK; }
EXPORT fmi3Status fmi3ExitConfigurationMode(C c) { (void)c; return fmi3OK; }

EXPORT fmi3Status fmi3GetOutputDerivatives(C c, V r, size_t n, const int32_t orders[],
    fmi3Float64 values[], size_t k)
{
    (void)c; (void)r; (void)orders; (void)values; (void)k;
    return n ? fmi3Error : fmi3OK;
}

EXPORT fmi3Status fmi3DoStep(C c, fmi3Float64 now, fmi3Float64 h, fmi3Boolean final,
    fmi3Boolean *event, fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *last)
{
    unit *m = (unit *)c;
    (void)final;
    if (!(h >= 0.0)) return fmi3Error;
    pass(m, h);
    m->passed = now + h - m->begun;
    *event = false;
    *end = false;
    *early = false;
    *last = now + h;
    return fmi3OK;
}
"""

_REST: Final = (
    "GetDirectionalDerivative GetAdjointDerivative GetNumberOfVariableDependencies "
    "GetVariableDependencies GetIntervalDecimal GetIntervalFraction GetShiftDecimal "
    "GetShiftFraction SetIntervalDecimal SetIntervalFraction SetShiftDecimal SetShiftFraction "
    "EvaluateDiscreteStates UpdateDiscreteStates EnterContinuousTimeMode "
    "CompletedIntegratorStep SetTime SetContinuousStates GetContinuousStateDerivatives "
    "GetEventIndicators GetContinuousStates GetNominalsOfContinuousStates "
    "GetNumberOfEventIndicators GetNumberOfContinuousStates ActivateModelPartition"
)
"""Functions that every library must have and that nothing here needs."""


def source(plan: Plan, variables: Sequence[Variable], token: str) -> str:
    """The C text of a unit for FMI 3.0, which includes that of the model."""
    text = shared(plan, variables, token, exchange=False)
    text = text.replace("    int initialising;", "    double passed;\n    int initialising;")
    rest = "\n".join(
        f"EXPORT fmi3Status fmi3{name}(C c) {{ (void)c; return fmi3Error; }}"
        for name in _REST.split()
    )
    return f"{text}{_TEXT}\n/* Not for co-simulation, or not of this unit. */\n{rest}\n"
