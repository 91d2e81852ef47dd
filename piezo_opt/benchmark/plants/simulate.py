"""The plant with its hidden effects, from the command to the clean reading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import final

import numpy as np

from piezo_opt.benchmark.plants.hidden import Back, Force, Grip, Hidden, Pull, Scene
from piezo_opt.benchmark.plants.physics import (
    Array,
    Base,
    mechanics,
    path,
    pole_of,
)


@final
@dataclass(frozen=True)
class Trace:
    """The clean reading of a record [m], and where the plant was when the record began."""

    reading: Array
    loop: float
    position: float
    velocity: float


@final
class Loop:
    """One loop with the terms that hidden effects add to it, moved along by its drive."""

    def __init__(self, base: Base, pulls: Sequence[Pull]) -> None:
        self._alpha, self._beta, self._gamma = base.alpha, base.beta, base.gamma
        self._rest, self._pivot = base.exponent - 1.0, base.pivot
        self._pulls = tuple(pulls)
        self.h = base.start_loop

    def move(self, drive: float, move: float, seconds: float) -> float:
        """Move by ``move`` volts from ``drive``; the implicit midpoint rule in two passes."""
        h = middle = self.h
        half = 0.5 * move
        turned = self._beta if move > 0.0 else -self._beta
        for _ in range(2):
            k = turned + (self._gamma if middle > 0.0 else -self._gamma)
            if self._rest != 0.0:
                k *= (abs(middle) / self._pivot) ** self._rest
            push, drag = self._alpha * half, k * half
            for pull in self._pulls:
                added, slowed = pull(drive + half, move, seconds, middle)
                push += 0.5 * added
                drag += 0.5 * slowed
            middle = (h + push) / (1.0 + drag)
        self.h = 2.0 * middle - h
        return self.h


def simulate(base: Base, effects: Sequence[Hidden], scene: Scene) -> Trace:
    """The reading of the plant under ``scene``, on its samples.

    The chain is fed forward wherever physics allows: only forces, holds and the charge's way
    back to the drive are stepped together with the mechanics.
    """
    ends = scene.ends
    for effect in effects:
        ends = effect.drive(scene, ends)
    pulls = [pull for effect in effects if (pull := effect.pull()) is not None]
    loop = _along(base, pulls, scene, ends)
    free = base.gain * ends - loop
    added = np.zeros_like(free)
    for effect in effects:
        more = effect.strain(scene, ends, free)
        if more is not None:
            added = added + more
    free = free + added
    forces = [force for effect in effects if (force := effect.force(scene)) is not None]
    grips = [grip for effect in effects if (grip := effect.grip(scene)) is not None]
    backs = [back for effect in effects if (back := effect.back()) is not None]
    if backs:
        stepped = _Stepped(base, scene, forces, grips)
        x, w, free = stepped.coupled(ends, added, backs[0], Loop(base, pulls))
    elif base.static:
        x, w = _Stepped(base, scene, forces, grips).still(free)
    elif forces or grips:
        x, w = _Stepped(base, scene, forces, grips).moving(free)
    else:
        x, w = mechanics(free, base.omega, base.zeta, float(free[0, 0]), 0.0, scene.grid.step)
    reading = x
    for effect in effects:
        reading = effect.read(scene, free, reading)
    start = scene.grid.first * scene.grid.substeps
    began = float(loop[0, start]) if start < loop.shape[1] else base.start_loop
    return Trace(scene.grid.sampled(reading) + base.offset, began, float(x[start]), float(w[start]))


def _along(base: Base, pulls: Sequence[Pull], scene: Scene, ends: Array) -> Array:
    """The loop along the whole drive, at both ends of every sub-step [m]."""
    way = path(ends, base.width, with_rest=bool(pulls))
    loop = Loop(base, pulls)
    out = [loop.h]
    drive = float(ends[0, 0])
    seconds = (way.share * scene.grid.step).tolist()
    for move, took in zip(way.moves.tolist(), seconds, strict=True):
        out.append(loop.move(drive, move, took))
        drive += move
    return np.array(out)[way.index]


@final
class _Stepped:
    """The mechanics stepped together with forces, by their exact response (predict, correct)."""

    def __init__(
        self, base: Base, scene: Scene, forces: Sequence[Force], grips: Sequence[Grip]
    ) -> None:
        self._base, self._scene = base, scene
        self._forces, self._grips = tuple(forces), tuple(grips)
        step = scene.grid.step
        pole = pole_of(base.omega, base.zeta)
        self._pole = pole
        self._grown = complex(np.exp(pole * step))
        total = (self._grown - 1.0) / pole
        late = (total - step) / (pole * step)
        square = base.omega**2
        self._early, self._late = square * (total - late), square * late

    def _taken(self, position: float, velocity: float, free: float, time: float) -> float:
        """What all forces take away there."""
        taken = 0.0
        for force in self._forces:
            taken += force.at(position, velocity, free, time)
        return taken

    def _keep(self) -> None:
        for force in self._forces:
            force.keep()

    def _held(self, free: float, position: float, time: float) -> bool:
        return any([grip.holds(free, position, time) for grip in self._grips])

    def _rest(self, free: float, time: float) -> tuple[float, float]:
        """Where the position rests at the start, and what the forces take there."""
        x = free
        for _ in range(12):
            x = free - self._taken(x, 0.0, free, time)
        taken = self._taken(x, 0.0, free, time)
        self._keep()
        return x, taken

    def still(self, free: Array) -> tuple[Array, Array]:
        """Position without inertia: x = s - what the forces take at x, at every node."""
        times = self._scene.grid.time.tolist()
        x, _ = self._rest(float(free[0, 0]), times[0])
        if not self._forces and not self._grips:
            return np.concatenate(([x], free[1])), np.zeros(free.shape[1] + 1)
        out = [x]
        for right, time in zip(free[1].tolist(), times[1:], strict=True):
            if not (self._grips and self._held(right, x, time)):
                # A secant on s - x - f(x): the forces may be stiff against the spring.
                a = x
                fa = right - a - self._taken(a, 0.0, right, time)
                b = a + fa
                for _ in range(4):
                    fb = right - b - self._taken(b, 0.0, right, time)
                    if abs(fb) < 1e-15 or fa == fb:
                        break
                    a, fa, b = b, fb, b - fb * (b - a) / (fb - fa)
                self._taken(b, 0.0, right, time)
                self._keep()
                x = b
            out.append(x)
        return np.array(out), np.zeros(len(out))

    def _ahead(
        self, c: complex, left: float, right: float, taken: float, time: float
    ) -> tuple[complex, float, float]:
        """The mechanics, their position and velocity one sub-step on, forces predicted first."""
        turn, decay = self._pole.imag, self._pole.real
        common = self._grown * c + self._early * (left - taken)
        c = common + self._late * (right - taken)
        x = c.imag / turn
        if self._forces:
            guess = self._taken(x, c.real + decay * x, right, time)
            c = common + self._late * (right - guess)
            x = c.imag / turn
        return c, x, c.real + decay * x

    def moving(self, free: Array) -> tuple[Array, Array]:
        """Position and velocity at the nodes."""
        times = self._scene.grid.time.tolist()
        x, taken = self._rest(float(free[0, 0]), times[0])
        w = 0.0
        back = self._pole.conjugate()
        c = w - back * x
        xs, ws = [x], [w]
        for left, right, time in zip(free[0].tolist(), free[1].tolist(), times[1:], strict=True):
            if self._grips and self._held(right, x, time):
                c, w = -back * x, 0.0
            else:
                c, x, w = self._ahead(c, left, right, taken, time)
                taken = self._taken(x, w, right, time)
                self._keep()
            xs.append(x)
            ws.append(w)
        return np.array(xs), np.array(ws)

    def coupled(
        self, ends: Array, added: Array, back: Back, loop: Loop
    ) -> tuple[Array, Array, Array]:
        """Position, velocity and free displacement with the motion's charge on the drive.

        The lagged velocity of the next node is extrapolated from the last two, and the step is
        taken again, loop and all, with what came out: a loop that is first led too far and then
        back has turned twice.
        """
        base, step = self._base, self._scene.grid.step
        times = self._scene.grid.time.tolist()
        drive = float(ends[0, 0])
        s = base.gain * drive - loop.h + float(added[0, 0])
        x, taken = self._rest(s, times[0])
        w = slow = quick = before = 0.0
        conjugate = self._pole.conjugate()
        c = w - conjugate * x
        xs, ws, frees = [x], [w], np.empty_like(ends)
        slower, quicker = np.exp(-step / back.slow), np.exp(-step / back.quick)

        def led(there: float, seconds: float) -> float:
            """Lead the loop to a drive."""
            parts = max(ceil(abs(there - drive) * base.width / 0.04), 1)
            part = (there - drive) / parts
            for k in range(parts):
                loop.move(drive + k * part, part, seconds / parts)
            return there

        columns = zip(*ends.tolist(), *added.tolist(), times[1:], strict=True)
        for i, (left, right, more_left, more_right, time) in enumerate(columns):
            drive = led(left - back.kappa * quick, 0.0)
            frees[0, i] = base.gain * drive - loop.h + more_left
            at, turned = drive, loop.h
            guess = 2.0 * quick - before
            held = None
            for _ in range(2):
                drive, loop.h = at, turned
                drive = led(right - back.kappa * guess, step)
                s = base.gain * drive - loop.h + more_right
                if held is None:
                    held = bool(self._grips) and self._held(s, x, time)
                if held:
                    moved, reached, now = -conjugate * x, x, 0.0
                else:
                    moved, reached, now = self._ahead(c, frees[0, i], s, taken, time)
                middle = 0.5 * (w + now)
                after = middle + (slow - middle) * slower
                half = 0.5 * (slow + after)
                guess = half + (quick - half) * quicker
            frees[1, i] = s
            if not held:
                taken = self._taken(reached, now, s, time)
                self._keep()
            before, quick = quick, guess
            c, x, slow, w = moved, reached, after, now
            xs.append(x)
            ws.append(w)
        return np.array(xs), np.array(ws), frees
