"""Predictive control as C, the law of :class:`piezo_opt.control.MPC`: one program a sample."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Iterable, Sequence
from importlib import resources
from typing import Any, Final

import casadi as ca

from piezo_opt.assembly import System, assemble, folded
from piezo_opt.control import MPC, Limits
from piezo_opt.control.motion import RISE
from piezo_opt.control.observe import PATIENCE
from piezo_opt.control.qp import NARROW, TOLERANCE
from piezo_opt.export.c import naming
from piezo_opt.export.c.graph import Graph
from piezo_opt.export.c.lacking import lacking
from piezo_opt.export.c.pen import comment
from piezo_opt.export.c.printer import WIDTH, Precision, Printer, wrapped
from piezo_opt.export.laws import written
from piezo_opt.export.laws.written import Written
from piezo_opt.symbolic import one_at_a_time

_TITLE: Final = "predictive control with the fitted, hysteretic model."
_ABOUT: Final = """\
   min  sum ((y_k + d - r_k) / Y)^2 + weight (w_k / U)^2,   u_k = u_(k-1) + w_k
   with u and w within range and slew rate, and y within its stroke (softly)
At every sample an extended Kalman filter reads states and disturbance d, the model is linearised
along the moves w of last time, and one quadratic program of at most {most} iterations gives the
next ones: a real-time iteration.
Diehl et al. (2002), J. Process Control 12(4), 577-585."""

FLOAT_TOLERANCE: Final = 1e-5
FLOAT_NARROW: Final = 1e-6
"""What four bytes can tell apart, in the places of those of eight."""
_FAR: Final = 1e15
"""A gate that is none [m]: its square is a float."""

STATES: Final = """\
    {n}_UNFINISHED = 4, /* the program ended with its last iteration */
    {n}_FAILED = 8      /* the program led to what is no number: the drive is held */
"""

_PERIOD: Final = """\
/* One step h of the classical Runge-Kutta scheme, and, unless X is null, its derivatives along ND
   directions. */
static void runge_kutta(const double *p, double t, double h, double u, const double *U, double du,
                        const double *DU, double *x, double *X) {
  double k[NX + 1], K[(NX + 1) * ND], sum[NX + 1], SUM[(NX + 1) * ND], at[NX + 1];
  double fx[NX * NX + 1], fu[NX + 1], fr[NX + 1];
  for (int i = 0; i < NX * NX + 1; ++i) fx[i] = 0.0;
  for (int i = 0; i < NX + 1; ++i) fu[i] = fr[i] = k[i] = sum[i] = 0.0;
  for (int i = 0; i < (NX + 1) * ND; ++i) K[i] = SUM[i] = 0.0;
  for (int stage = 0; stage < 4; ++stage) {
    const double since = stage == 0 ? 0.0 : stage == 3 ? h : 0.5 * h;
    const double weight = stage == 1 || stage == 2 ? 2.0 : 1.0;
    double AT[(NX + 1) * ND];
    for (int i = 0; i < NX; ++i) at[i] = x[i] + since * k[i];
    for (int i = 0; X && i < NX * ND; ++i) AT[i] = X[i] + since * K[i];
    slopes(p, t + since, at, u + du * since, du, k, fx, fu, fr);
    for (int i = 0; i < NX; ++i) sum[i] += weight * k[i];
    for (int i = 0; X && i < NX; ++i) {
      double *row = K + i * ND;
      for (int d = 0; d < ND; ++d) row[d] = fu[i] * (U[d] + DU[d] * since) + fr[i] * DU[d];
      for (int j = 0; j < NX; ++j) {
        const double slope = fx[i * NX + j];
        for (int d = 0; d < ND; ++d) row[d] += slope * AT[j * ND + d];
      }
    }
    for (int i = 0; X && i < NX * ND; ++i) SUM[i] += weight * K[i];
  }
  for (int i = 0; i < NX; ++i) x[i] += h / 6.0 * sum[i];
  for (int i = 0; X && i < NX * ND; ++i) X[i] += h / 6.0 * SUM[i];
}

@SETTLE
/* A period T: the drive goes to its new value within the first part, and is held. */
static void period(const double *p, double t, double before, const double *BEFORE, double after,
                   const double *AFTER, double T, long rise, long held, double *x, double *X) {
  const double up = @RISE * T;
  double du = (after - before) / up, DU[ND], U[ND], h = up / (double)rise;
  for (int d = 0; X && d < ND; ++d) DU[d] = (AFTER[d] - BEFORE[d]) / up;
  for (long k = 0; k < rise; ++k) {
    const double s = (double)k * h;
    for (int d = 0; X && d < ND; ++d) U[d] = BEFORE[d] + DU[d] * s;
    runge_kutta(p, t + s, h, before + du * s, U, du, DU, x, X);
  }
  t += up;
  @SETTLED
  h = (T - up) / (double)held;
  du = 0.0;
  for (int d = 0; d < ND; ++d) DU[d] = 0.0;
  for (long k = 0; k < held; ++k) runge_kutta(p, t + (double)k * h, h, after, AFTER, du, DU, x, X);
  @SETTLED_LAST
}

/* The reading and its derivatives along the directions. */
static void reading(const double *p, double t, const double *x, const double *X, double u,
                    const double *U, double *y, double *Y) {
  double yx[NX + 1], yu = 0.0;
  for (int i = 0; i < NX + 1; ++i) yx[i] = 0.0;
  shown(p, t, x, u, y, yx, &yu);
  for (int d = 0; X && d < ND; ++d) Y[d] = yu * U[d];
  for (int i = 0; X && i < NX; ++i)
    for (int d = 0; d < ND; ++d) Y[d] += yx[i] * X[i * ND + d];
}

"""
_SETTLE: Final = """\
/* What remembers turns, behind a stretch of the drive in one direction. */
static void settle(const double *p, double t, double u, const double *U, double du,
                   const double *DU, double *x, double *X) {
  double after[NX + 1], AFTER[(NX + 1) * ND], jx[NX * NX + 1], ju[NX + 1], jr[NX + 1];
  for (int i = 0; i < NX * NX + 1; ++i) jx[i] = 0.0;
  for (int i = 0; i < NX + 1; ++i) ju[i] = jr[i] = 0.0;
  jumps(p, t, x, u, du, after, jx, ju, jr);
  for (int i = 0; X && i < NX; ++i)
    for (int d = 0; d < ND; ++d) {
      double sum = ju[i] * U[d] + jr[i] * DU[d];
      for (int j = 0; j < NX; ++j) sum += jx[i * NX + j] * X[j * ND + d];
      AFTER[i * ND + d] = sum;
    }
  for (int i = 0; i < NX; ++i) x[i] = after[i];
  for (int i = 0; X && i < NX * ND; ++i) X[i] = AFTER[i];
}

"""

_ACT: Final = """\
/* The states at rest at a drive, and a disturbance that may be anywhere. */
static void rest(@n *c, double drive) {
  for (int i = 0; i < NE * NE; ++i) c->spread[i] = 0.0;
  for (int i = 0; i < NE; ++i) c->x[i] = 0.0;
  resting(&c->parameters, drive, c->x);
  c->spread[NE * NE - 1] = c->anywhere * c->anywhere;
  c->off = 0;
}

void @n_init(@n *c) {
  double drive = 0.0;
@assigned  if (drive < c->low) drive = c->low;
  if (drive > c->high) drive = c->high;
  rest(c, drive);
  for (int i = 0; i < HORIZON; ++i) c->moves[i] = c->ahead[i] = 0.0;
  for (int i = 0; i <= DELAY; ++i) c->waiting[i] = drive;
  c->held = c->drive = drive;
  c->samples = 0;
  c->iterations = 0;
  c->status = 0;
}

/* The estimate with a reading; whether that was one. */
static int observe(@n *c, double seen) {
  const double t = (double)c->samples * PERIOD;
  const int begun = c->samples > 0;
  const double drive = begun ? c->waiting[0] : c->held;
  double noises[4] = {c->drive_noise, c->drift, c->noise, c->gate};
  int used = 0, going = 1;
  if (begun && c->off >= PATIENCE) {
    /* Off for so long it is the estimate that is wrong. */
    c->spread[NE * NE - 1] += c->gate * c->gate;
    noises[3] = FAR;
  }
  if (begun)
    going = predict(&c->parameters, t - PERIOD, c->held, drive, PERIOD, RISE_STEPS, HELD_STEPS,
                    noises, c->x, c->spread);
  if (!going) {
    /* What is known leads to what is no number: begin anew at rest. */
    rest(c, drive);
    noises[3] = c->gate;
  }
  used = correct(&c->parameters, t, drive, seen, noises, c->x, c->spread);
  if (begun && going) c->off = used ? 0 : c->off + isfinite(seen);
  if (begun) {
    c->held = drive;
    for (int i = 0; i < DELAY; ++i) c->waiting[i] = c->waiting[i + 1];
    /* Behind the plan's end the drive goes on; where a resonance is stilled moves alternate. */
    const double on = 0.5 * (c->moves[HORIZON - 1] + c->moves[HORIZON > 1 ? HORIZON - 2 : 0]);
    for (int i = 0; i + 1 < HORIZON; ++i) c->moves[i] = c->moves[i + 1];
    c->moves[HORIZON - 1] = on;
  }
  return used;
}

double @n_act_ahead(@n *c, const double *references, double reading) {
@limits  const int used = observe(c, reading);
  double told[3] = {0.0, 0.0, 0.0}, drive = c->drive;
  int wanted = 1;
  c->status = used ? 0 : @n_MISSED;
  for (int i = 0; i < HORIZON; ++i) wanted = wanted && isfinite(references[i]);
  if (drive < low) drive = low;
  if (drive > high) drive = high;
  if (wanted) {
    const double weights[4] = {c->error_weight, c->move_weight, 1.0, c->price};
    const double bounds[7] = {c->low, c->high, c->move / PERIOD, c->least, c->most, low, high};
    for (int i = 0; i < ROUNDS; ++i)
      drive = decide(HORIZON, ITERATIONS, &c->parameters, (double)c->samples * PERIOD, PERIOD,
                     c->x, c->held, DELAY, c->waiting, RISE_STEPS, HELD_STEPS, references, weights,
                     bounds, c->moves, c->work, told);
    if (told[2] > 0.0) c->status |= @n_FAILED;
    else if (told[0] > ITERATIONS - 0.5) c->status |= @n_UNFINISHED;
  } else {
    c->status |= @n_MISSED;
  }
  c->iterations = (int)told[0];
  if (drive <= low || drive >= high) c->status |= @n_LIMITED;
  c->waiting[DELAY] = drive;
  c->drive = drive;
  ++c->samples;
  return drive;
}

double @n_act(@n *c, double reference, double reading) {
  for (int i = 0; i < HORIZON; ++i) c->ahead[i] = reference;
  return @n_act_ahead(c, c->ahead, reading);
}
"""


def mpc(law: MPC, name: str, precision: Precision, limits: Limits) -> Written:
    """Header and source of predictive control.

    Args:
        law: model, horizon, weights and filter.
        name: prefix of every symbol.
        precision: type of the numbers.
        limits: of the drive.
    """
    system = _system(law)
    functions, called = _functions(system, name, precision)
    body = "\n".join(lacking(called, name, precision)) + "\n" if called else ""
    body += _defines(law, precision)
    model = resources.files("piezo_opt.control")
    sources = [model.joinpath(f).read_text(encoding="utf-8") for f in ("horizon.c", "predictive.c")]
    jumps = system.becomes is not None
    settled = "settle(p, t, after, AFTER, du, DU, x, X);" if jumps else ""
    period = (
        _PERIOD.replace("@RISE", repr(RISE))
        .replace("@SETTLED_LAST", f"t += T - up;\n  {settled}" if jumps else "")
        .replace("@SETTLED", settled)
        .replace("@SETTLE\n", _SETTLE if jumps else "")
    )
    act = _ACT.replace("@limits", written.LIMITS).replace(
        "@assigned", _assigned(law, system, limits)
    )
    act = act.replace("{real}", "double").replace("{n}", name).replace("@n", name)
    within = written.WITHIN.replace("{n}", name).replace("{real}", "double")
    texts = [within.replace("{zero}", "0.0"), sources[0], sources[1], act]
    own = [typed(one, name, precision) for one in texts]
    body += own[0] + own[1] + "\n" + functions + typed(period, name, precision) + own[2] + "\n"
    body += own[3]
    title, about = _TITLE, _ABOUT.format(most=law.iterations)
    real = precision.name
    header, source = written.framed(
        name, precision, title, about, law.period, _members(law, name, precision),
        "The drive [V] for a reference that is taken to last, and a reading [m].",
        f"{real} reference, {real} reading", body, before=_parameters(system, name, real),
        states=STATES.format(n=name),
        after=(
            f"\n/* The same with the references [m] at the ends of the {law.horizon} periods after "
            f"the\n   one{'s that wait' if law.delay else ''} in which the drive takes effect. */\n"
            f"{real} {name}_act_ahead({name} *c, const {real} *references, {real} reading);\n"
        ),
    )  # fmt: skip
    return Written(
        title, header, source, ("reference [m]", "reading [m]"),
        f"{name}_act(&one, ({real})row[0], ({real})row[1])", "drive [V]",
    )  # fmt: skip


def typed(text: str, name: str, precision: Precision) -> str:
    """C of eight bytes in another type, with the parameters' own struct; comments stay."""

    def code(part: str) -> str:
        part = part.replace("isfinite(", f"{name}_is_number(")
        part = part.replace("const double *p,", f"const {name}_parameters *p,")
        part = part.replace("const double *p;", f"const {name}_parameters *p;")
        if not precision.is_float:
            return part
        part = re.sub(r"\bdouble\b", "float", part)
        part = re.sub(r"\b(fabs|fmin|fmax|sqrt)\(", r"\1f(", part)
        number = r"(?<![\w.])(\d+\.\d*(?:e[-+]?\d+)?|\d+e[-+]?\d+)"
        return re.sub(number, lambda m: precision.number(float(m[1])), part)

    parts = re.split(r"(/\*.*?\*/)", text, flags=re.DOTALL)
    return "".join(one if k % 2 else code(one) for k, one in enumerate(parts))


def _defines(law: MPC, precision: Precision) -> str:
    narrow, enough = (
        (FLOAT_NARROW, FLOAT_TOLERANCE) if precision.is_float else (NARROW, TOLERANCE)
    )  # fmt: skip
    h = law.observer.horizon
    pairs = [
        ("NX", str(h.states)), ("NZ", "(NX + 1)"), ("ND", "(NX + 2)"),
        ("HORIZON", str(law.horizon)), ("DELAY", str(law.delay)),
        ("ITERATIONS", str(law.iterations)), ("ROUNDS", str(law.rounds)),
        ("PERIOD", precision.number(law.period)), ("RISE_STEPS", str(h.steps.rise)),
        ("HELD_STEPS", str(h.steps.held)), ("PATIENCE", str(PATIENCE)),
        ("FAR", precision.number(_FAR)), ("TOLERANCE", precision.number(enough)),
        ("NARROW", precision.number(narrow)),
    ]  # fmt: skip
    return "".join(f"#define {k} {v}\n" for k, v in pairs) + "\n"


def _numbers(law: MPC) -> dict[str, float]:
    """Values of the model's parameters, by full name."""
    h = law.observer.horizon
    return dict(zip(h.system.parameter_names, h.p.tolist(), strict=True))


def _system(law: MPC) -> System:
    """The model's equations; what it declares fixed is a number in them."""
    model, values = law.observer.horizon.system.model, _numbers(law)
    return assemble(model, {name: values[name] for name in folded(model)})


def _parameters(system: System, name: str, real: str) -> str:
    lines = [
        f"    {f'{real} {one.name};':<34} /* {naming.plain(f'{one.meaning} [{one.unit}]')} */\n"
        for one in naming.parameters(system)
    ]
    # A struct without a member is none in C.
    lines = lines or [f"    {real} none;\n"]
    return f"/* Of the model. */\ntypedef struct {{\n{''.join(lines)}}} {name}_parameters;\n\n"


_NUMBERS: Final = (
    *written.LIMIT_MEMBERS, ("least", "lowest position that is allowed [m]"),
    ("most", "highest one [m]"), ("error_weight", "of the error [1/m^2]"),
    ("move_weight", "of the drive's moves [1/V^2]"),
    ("price", "of a position beyond what is allowed [1/m]"), ("noise", "of the reading [m]"),
    ("drive_noise", "of the drive [V]"), ("drift", "of the disturbance in a period [m]"),
    ("gate", "distance from which a reading is none [m]"),
    ("anywhere", "of the disturbance at first [m]"), ("drive", "of the last sample [V]"),
    ("held", "the drive before [V]"),
)  # fmt: skip


def _columns(law: MPC) -> tuple[tuple[str, int, str], ...]:
    """Members with several numbers: name, how many, meaning."""
    n = law.observer.horizon.states + 1
    work = int(law.observer.horizon.library.po_move_size(law.horizon))
    return (
        ("x", n, "estimated states, and disturbance [m]"), ("spread", n * n, "their covariance"),
        ("moves", law.horizon, "planned moves of the drive [V]"),
        ("waiting", law.delay + 1, "drives that wait for their period [V]"),
        ("ahead", law.horizon, "references [m]"), ("work", work, "room for the program"),
    )  # fmt: skip


_COUNTS: Final = (
    ("unsigned long", "samples", "since the start"),
    ("int", "off", "readings in a row beyond the gate"),
    ("int", "iterations", "of the last program"),
)


def _members(law: MPC, name: str, precision: Precision) -> str:
    real = precision.name
    pairs = [(f"{name}_parameters", "parameters", "of the model")]
    pairs += [(real, member, meaning) for member, meaning in _NUMBERS]
    pairs += [(real, f"{member}[{size}]", meaning) for member, size, meaning in _columns(law)]
    pairs += _COUNTS
    return "".join(
        f"    {f'{kind} {member};':<34} /* {meaning} */\n" for kind, member, meaning in pairs
    )


def memory(law: MPC, name: str, precision: str) -> type[ctypes.Structure]:
    """The struct as it lies in memory."""
    real = ctypes.c_float if precision == "float" else ctypes.c_double
    count = max(1, len(naming.parameters(_system(law))))
    kinds = {"unsigned long": ctypes.c_ulong, "int": ctypes.c_int}
    fields: list[tuple[str, Any]] = [("parameters", real * count)]
    fields += [(member, real) for member, _ in _NUMBERS]
    fields += [(member, real * size) for member, size, _ in _columns(law)]
    fields += [(member, kinds[kind]) for kind, member, _ in _COUNTS]
    fields += [("status", ctypes.c_int)]
    return type(name, (ctypes.Structure,), {"_fields_": fields})


def _assigned(law: MPC, system: System, limits: Limits) -> str:
    values = _numbers(law)
    low, high = law.stroke or (-written.FAR, written.FAR)
    drive_noise, drift, noise, gate = (float(v) for v in law.observer.noises)
    numbers = {
        **{f"parameters.{f.name}": values[f.full] for f in naming.parameters(system)},
        **written.numbers(limits, law.period), "least": low, "most": high,
        "error_weight": float(law.weights[0]), "move_weight": float(law.weights[1]),
        "price": float(law.weights[3]), "noise": noise, "drive_noise": drive_noise,
        "drift": drift, "gate": min(gate, _FAR), "anywhere": 1e3 * noise,
    }  # fmt: skip
    return "".join(f"  c->{k} = {v!r};\n" for k, v in numbers.items())


@one_at_a_time
def _functions(system: System, name: str, precision: Precision) -> tuple[str, set[str]]:
    """The model's equations and their derivatives as functions of C."""
    states = [
        re.sub(r"\W+", "_", e).strip("_") for f in naming.states(system) for e in f.elements
    ]  # fmt: skip
    n, none = len(states), ca.SX(0, 1)
    t, x, u, du = ca.SX.sym("t"), ca.SX.sym("x", n), ca.SX.sym("u"), ca.SX.sym("du")
    p = ca.SX.sym("p", len(system.parameter_names))
    inputs = [t, x, u, du, p]
    leaves = [
        ["time"], states, ["drive"], ["drive_rate"],
        [f"p->{f.name}" for f in naming.parameters(system)],
    ]  # fmt: skip
    rate = system.rate(t, x, u, du, none, none, p)
    read = system.reading(t, x, u, 0.0, none, none, p)
    rest = system.start(0.0, u, none, p, ca.SX.zeros(n))
    made = [
        ("slopes", "How fast the states move, and the derivatives of that.",
         (("f", rate), ("fx", ca.jacobian(rate, x)), ("fu", ca.jacobian(rate, u)),
          ("fr", ca.jacobian(rate, du)))),
        ("shown", "The reading, and its derivatives.",
         (("y", read), ("yx", ca.jacobian(read, x)), ("yu", ca.jacobian(read, u)))),
        ("resting", "The states at rest.", (("at", rest),)),
    ]  # fmt: skip
    if system.becomes is not None:
        after = system.becomes(t, x, u, du, none, p)
        made.append((
            "jumps", "What becomes of states that jump.",
            (("after", after), ("jx", ca.jacobian(after, x)), ("ju", ca.jacobian(after, u)),
             ("jr", ca.jacobian(after, du))),
        ))  # fmt: skip
    out: list[str] = []
    called: set[str] = set()
    for function, said, results in made:
        graph = Graph()
        # Row after row, and zeros are those that the caller has put there.
        flat = [ca.vec(ca.densify(ca.SX(value)).T) for _, value in results]
        nodes = graph.take(inputs, leaves, flat)
        kept = [
            (f"{to}[{i}] =", k)
            for first, ((to, _), own) in enumerate(zip(results, nodes, strict=True))
            for i, k in enumerate(own)
            if first == 0 or not graph.is_number(k, 0.0)
        ]
        printer = Printer(graph, precision, name, {}, system.model.names)
        lines = printer.statements(kept)
        called |= printer.called
        used = set(graph.leaves([k for _, k in kept]))
        out += _function(function, said, [r for r, _ in results], states, used, lines, name,
                         precision.name)  # fmt: skip
    return "\n".join(out) + "\n", called


def _function(
    function: str, said: str, results: Sequence[str], states: Sequence[str], used: set[str],
    lines: Iterable[str], name: str, real: str,
) -> list[str]:  # fmt: skip
    """One of the model's functions, with names for the states that it reads."""
    rest, reads = function == "resting", function == "shown"
    given = [f"const {name}_parameters *p"]
    if not rest:
        given += [f"{real} time", f"const {real} *x"]
    given += [f"{real} drive"]
    if not (rest or reads):
        given += [f"{real} drive_rate"]
    given += [f"{real} *{one}" for one in results]
    words = "\n".join(lines)
    unused = [
        one for one in ("p", "time", "x", "drive", "drive_rate", *results)
        if any(g.split()[-1].lstrip("*") == one for g in given)
        and not (
            f"{one}->" in words or f"{one}[" in words or one in used
            or (one == "x" and any(s in used for s in states))
        )
    ]  # fmt: skip
    return [
        *comment(said), *wrapped(f"static void {function}({', '.join(given)})", WIDTH), "{",
        *(f"    (void){one};" for one in unused),
        *(f"    const {real} {s} = x[{i}];" for i, s in enumerate(states) if s in used),
        *(f"    {line}" for line in lines), "}", "",
    ]  # fmt: skip
