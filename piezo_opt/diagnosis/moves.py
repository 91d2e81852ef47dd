"""The neighbours of a set: one member more, one less, or one in the place of another.

A member is an effect in one of its forms, the details of an effect's shape, mechanics that were
left out, or another hysteresis law. Each neighbour begins where its fit is likely to end: at the
values of the set with the member's one-step size, where it does what the one that it replaces did,
and at a fresh start, because a fit that lacks something is bent by it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from piezo_opt.diagnosis.base_point import ROUGH
from piezo_opt.diagnosis.book import Book, Start
from piezo_opt.diagnosis.following import WIDTHS
from piezo_opt.diagnosis.members import Members
from piezo_opt.diagnosis.richer import finer_form, freed, in_detail
from piezo_opt.diagnosis.scores import Suspect
from piezo_opt.effects.base import Effect, Place
from piezo_opt.effects.catalogue import CATALOGUE
from piezo_opt.effects.model import Model
from piezo_opt.effects.motion.spring import Spring
from piezo_opt.errors import ModelError
from piezo_opt.identification import Fit, Identification
from piezo_opt.identification.shapes import elsewhere, own

FloatArray = NDArray[np.float64]


def adds(
    at: Members, suspects: Sequence[Suspect], most: int, book: Book, *, fresh: bool = True
) -> list[Start]:
    """The likeliest effects, one at a time, each also in its finer form with its details free.

    What an effect does may show in its details alone: a limit that differs up and down is no limit
    that is the same. A fresh start has those of the law free as well, because what is missing has
    bent the law. Only the likelier form of each has one: another form is a neighbour of it.
    """
    found, asked = [], set()
    for suspect in _likeliest(suspects, most):
        start = _joined(at, (suspect,), book)
        if start is None:
            continue
        full = _in_full(_finer(start, suspect.name), suspect.name, book)
        found += [start, full]
        if fresh and suspect.name not in asked:
            law = full.members.law
            found.append(replace(_in_full(full, law, book) if law else full, values=None))
        asked.add(suspect.name)
    return found


def pairs(at: Members, suspects: Sequence[Suspect], most: int, book: Book) -> list[Start]:
    """The likeliest effects, two at a time: effects that hide each other are found so.

    With u_i the directions of length one and b_i = u_i' r, two explain b' G^-1 b of the residual,
    G = [[1, g], [g, 1]] and g = u_i' u_j. Worth a look is who explains more than the two best
    singles of that pair do one by one.
    """
    able = [s for s in suspects if not s.wrong_side and s.visibility > ROUGH]
    if len(able) < 2:
        return []
    units = np.column_stack([s.direction for s in able])
    gram = units.T @ units
    size = np.sign([s.size for s in able]) * np.sqrt([s.score for s in able])
    ranked: dict[frozenset[str], tuple[float, Suspect, Suspect]] = {}
    for i, j in combinations(range(len(able)), 2):
        one, other = able[i], able[j]
        if one.name == other.name or one.base is not other.base:
            continue
        g = float(gram[i, j])
        free = 1.0 - g * g
        if free < 1e-6:  # the same direction: as one
            continue
        along = np.array([size[i] - g * size[j], size[j] - g * size[i]]) / free
        # A one-sided gate that the other one would push to its forbidden side has no part.
        if _forbidden(one, along[0], size[i]) or _forbidden(other, along[1], size[j]):
            continue
        gain = float(along @ [size[i], size[j]])
        key = frozenset((one.name, other.name))
        if key not in ranked or ranked[key][0] < gain:
            ranked[key] = (gain, one, other)
    found: list[Start] = []
    for _, one, other in sorted(ranked.values(), key=lambda t: -t[0])[:most]:
        start = _joined(at, (one, other), book)
        if start is not None:
            found.append(start)
            # Another hysteresis law than the foot's begins at the widths of `laws`.
            own = start.members.law == book.base.law
            found += [replace(start, values=None)] if own else []
    return found


def details(fit: Fit, book: Book, *, quiet: bool = False) -> list[Start]:
    """What the set has already, in more detail; mechanics that were left out, also from a fresh
    start: a fit that lacks them is bent by that."""
    begun = [
        Start(Members.of(question, book.question), dict(start))
        for question, start in in_detail(fit, quiet=quiet)
    ]
    own = Members.of(fit.question, book.question)
    joined = dict.fromkeys(start.members for start in begun if start.members.base != own.base)
    fresh = [
        Start(members, None)
        for members in joined
        if members.model.quasi_static != fit.model.quasi_static
    ]
    return [*begun, *fresh, *([] if quiet else anew(fit, book))]


def still(at: Members, fit: Fit, foot: Identification) -> list[Start]:
    """The set without its mechanics, where no effect needs them and the user has not asked for any.

    A first fit may have bent them to imitate what is missing, and no step leads back from there;
    where they belong, they join again as a neighbour.
    """
    mechanics = next((name for name, effect in at.base if _moves(effect)), "")
    told = (*foot.fixed, *foot.bounds, *foot.priors, *foot.values)
    if not mechanics or any(name.startswith(f"{mechanics}.") for name in told):
        return []
    members = replace(at, base=at.base.without(mechanics))
    if any(e.place is Place.MOTION for e in at.effects) or not _allowed(members):
        return []
    return [Start(members, dict(fit.values)), Start(members, None)]


def laws(at: Members, fit: Fit, withheld: Sequence[str], book: Book) -> list[Start]:
    """Other hysteresis laws in the place of the base model's own: from where each ended in the best
    set that it was fitted in, or else from several widths, and from what both have by one name,
    with each of the histories from which its plays may begin.

    Each begins with its details free: where a loop that remembers its turns was reached from is one
    of them, and without it no density fits. Those that do not pay for themselves go at the end.
    """
    own_law = at.law
    if own_law is None:
        return []
    record = max(fit.records, key=lambda r: float(np.ptp(r.drive)))
    kept = {k: v for k, v in fit.values.items() if not k.startswith("initial.")}
    found = []
    for law in hysteresis_laws(withheld):
        if law == at.base[own_law]:
            continue
        details = freed(law.name, law, record)
        rest = (k for k in at.free if k.split(".")[0] != own_law)
        free = tuple(sorted((*rest, *details)))
        members = replace(at, base=at.base.replaced(own_law, law), free=free)
        known = next((m for m in book.sets if m.law and m.base[m.law] == law), None)
        if known is not None:
            ended = own(book[known].values, law.name)
            begun = {f"{law.name}.{k}": v for k, v in ended.items()}
            found.append(Start(members, {**kept, **details, **begun}))
            continue
        shared = {
            f"{law.name}.{k}": v for k, v in own(fit.values, own_law).items() if k in law.parameters
        }
        widths = (*_laws_starts(law, record.drive), shared)
        found += [Start(members, {**kept, **begun}) for begun in _anew(members, widths, book)]
        found.append(Start(members, None))
    return found


def at_home(at: Members, fit: Fit, book: Book) -> list[Start]:
    """The base model's own law in the place of another one, with its details and without: from what
    that one does there, and from where the own law ended in the best set that it was fitted in."""
    own_law = book.base.law
    if own_law is None or at.law is None or at.law == own_law:
        return []
    law, told = book.base.base[own_law], {*book.question.free, *book.question.fixed}
    kept = {k: v for k, v in fit.values.items() if not k.startswith("initial.")}
    details = freed(own_law, law, book.question.campaign.records[0])
    details = {k: v for k, v in details.items() if k not in told}
    known = next((own(book[m].values, own_law) for m in book.sets if m.law == own_law), {})
    alike = law.like(at.law, own(fit.values, at.law))
    rest = tuple(k for k in at.free if k.split(".")[0] != at.law)
    base = at.base.replaced(at.law, law)
    return [
        Start(
            replace(at, base=base, free=tuple(sorted({*rest, *free}))),
            {**kept, **free, **{f"{own_law}.{k}": v for k, v in begun.items()}},
        )
        for free in (({}, details) if details else ({},))
        for begun in ([known] if alike is None else [known, dict(alike)])
    ]


def anew(fit: Fit, book: Book) -> list[Start]:
    """The set with its law begun again, from several widths and from where it stands, with each of
    the histories from which its plays may begin: what was missing when it was fitted first may have
    led it to another minimum. Without effects, other laws than the base model's have begun so."""
    at = Members.of(fit.question, book.question)
    if at.law is None or not (at.effects or at.law == book.base.law):
        return []
    record = max(fit.records, key=lambda r: float(np.ptp(r.drive)))
    details = freed(at.law, at.base[at.law], record)
    asked = {*details} - {*book.question.free, *book.question.fixed}
    members = replace(at, free=tuple(sorted({*at.free, *asked})))
    kept = {k: v for k, v in fit.values.items() if not k.startswith((f"{at.law}.", "initial."))}
    stands = {f"{at.law}.{k}": v for k, v in own(fit.values, at.law).items()}
    widths = (*_laws_starts(at.base[at.law], record.drive), stands)
    return [Start(members, {**kept, **begun}) for begun in _anew(members, widths, book)]


def _anew(
    members: Members, widths: Iterable[Mapping[str, float]], book: Book
) -> Iterator[dict[str, float]]:
    """Values of a set's law at some widths, with each of the histories from which its plays may
    begin."""
    law = members.law or ""
    details = freed(law, members.base[law], book.question.campaign.records[0])
    for begun, moved in product(widths, ({}, *elsewhere(members.question(book.question)))):
        yield {**details, **begun, **moved}


def hysteresis_laws(withheld: Sequence[str]) -> list[Effect]:
    """The hysteresis laws of the catalogue, each in its finer form as well."""
    kinds = [kind() for name, kind in CATALOGUE.items() if name not in withheld]
    found: list[Effect] = []
    for law in (kind for kind in kinds if kind.is_hysteresis_law):
        finer, _ = law.finer({name: p.nominal for name, p in law.parameters.items()})
        found += [law] if finer == law else [law, finer]
    return found


def crossed(bare: Sequence[Members], most: int, book: Book) -> list[Start]:
    """Effects that help beside other laws, beside each law: what is missing is missing beside all
    of them, but one that bends easily hides it.

    With e the error without an effect and with it, the sum over the laws of ln(e_without / e_with)
    ranks the effects; each begins as it ended where it did most.

    Args:
        bare: sets that differ in their law.
        most: effects that are tried.
        book: where they were fitted.
    """
    errors = {m: max(book[m].rms, np.finfo(float).tiny) for m in book.sets}
    least: dict[Model, float] = {}
    for members, error in errors.items():
        if not members.effects:
            least[members.base] = min(error, least.get(members.base, np.inf))
    helps: dict[str, dict[str | None, tuple[float, Members]]] = {}
    for members, error in errors.items():
        if len(members.effects) == 1 and members.base in least:
            drop = float(np.log(least[members.base] / error))
            of_law = helps.setdefault(members.names[0], {})
            if drop > of_law.get(members.law, (0.0, members))[0]:
                of_law[members.law] = drop, members
    best = sorted(helps, key=lambda name: -sum(drop for drop, _ in helps[name].values()))
    found = []
    for name in best[:most]:
        if not helps[name]:
            continue
        _, donor = max(helps[name].values(), key=lambda pair: pair[0])
        ended = {k: v for k, v in book[donor].values.items() if k.startswith(f"{name}.")}
        details = tuple(k for k in donor.free if k.startswith(f"{name}."))
        for at in bare:
            members = at.with_(donor.effects[0])
            members = replace(members, free=tuple(sorted({*members.free, *details})))
            if _allowed(members):
                found.append(Start(members, {**book[at].values, **ended}))
    return found


def imitations(at: Members, fit: Fit, offered: Sequence[Effect], book: Book) -> list[Start]:
    """Effects that can do what a member does, or the mechanics, in its place and beginning with
    that: a damped resonance does much of what a lag does, and no step leads from it to the lag."""
    forms = dict.fromkeys(form for effect in offered for form in (effect, *effect.forms))
    places = [(member, at.without(member.name)) for member in at.effects]
    for start in still(at, fit, book.question)[:1]:
        (mechanics,) = (e for n, e in at.base if n not in start.members.base)
        places.append((mechanics, start.members))
    found = []
    for member, rest in places:
        does = own(fit.values, member.name)
        for effect in forms:
            # One that holds the member takes the place of its own simpler form as well.
            beside = effect.name in rest.names and not effect.holds_another
            if beside or effect.name == member.name:
                continue
            finer, _ = effect.finer({name: p.nominal for name, p in effect.parameters.items()})
            for form in dict.fromkeys((effect, finer) if member.structural else (effect,)):
                imitated = form.like(member.name, does)
                members = rest.with_(form)
                if imitated is not None and _allowed(members):
                    begun = {f"{form.name}.{k}": v for k, v in imitated.items()}
                    start = Start(members, {**fit.values, **begun})
                    found.append(start if form == effect else _in_full(start, form.name, book))
    return found


def less(at: Members, fit: Fit) -> Iterator[tuple[str, Start]]:
    """The set without one of its effects, each in turn, from where it stands."""
    for name in at.names:
        yield name, Start(at.without(name), dict(fit.values))


def _joined(at: Members, suspects: Sequence[Suspect], book: Book) -> Start | None:
    """A set with effects at their one-step sizes; None where no model can hold them together."""
    foot = suspects[0].base  # with the mechanics on which they were scored
    members = Members.of(foot.question, book.question)
    members = replace(members, effects=at.effects)
    values: dict[str, float] = dict(foot.values)
    for suspect in suspects:
        members = members.with_(suspect.effect)
        values |= _begun(suspect)
    return Start(members, values) if _allowed(members) else None


def _finer(start: Start, name: str) -> Start:
    """A start with an effect in its finer form: a lag of two poles may help where one does not."""
    values = start.values or {}
    finer, begun = finer_form(start.members.model, name, values)
    members = start.members.with_(finer)
    return Start(members, {**values, **{f"{name}.{k}": v for k, v in begun.items()}})


def _in_full(start: Start, name: str, book: Book) -> Start:
    """A start with the details of an effect's shape free."""
    effect = start.members.model[name]
    details = freed(name, effect, book.question.campaign.records[0])
    free = tuple(sorted({*start.members.free, *details}))
    return Start(replace(start.members, free=free), {**details, **(start.values or {})})


def _begun(suspect: Suspect) -> Mapping[str, float]:
    gate = suspect.effect.parameters[suspect.effect.gate or ""]
    size = float(np.clip(suspect.size, *gate.bounds))
    shapes = {f"{suspect.name}.{k}": v for k, v in suspect.shapes.items()}
    return {**shapes, f"{suspect.name}.{suspect.effect.gate}": size}


def _likeliest(suspects: Sequence[Suspect], most: int) -> list[Suspect]:
    """The forms of the likeliest names, best first, two forms a name at most.

    An effect that the fitted parameters imitate to the accuracy of its direction adds nothing, and
    would be credited with a fit that only got stuck without it.
    """
    seen = (s for s in suspects if not s.wrong_side and s.visibility > ROUGH)
    able = sorted(seen, key=lambda s: -s.score)
    names = [*dict.fromkeys(s.name for s in able)][:most]
    return [s for name in names for s in [s for s in able if s.name == name][:2]]


def _forbidden(suspect: Suspect, along: float, alone: float) -> bool:
    """Whether a gate would have to move to the side where it has no value."""
    gate = suspect.effect.parameters[suspect.effect.gate or ""]
    null = gate.null or 0.0
    low, high = gate.bounds
    turned = along * alone < 0.0
    one_sided = low >= null or high <= null
    return turned and one_sided


def _moves(effect: Effect) -> bool:
    return any(state.position for state in effect.declared_states.values())


def _allowed(members: Members) -> bool:
    """Whether a model can hold these effects together: what follows the velocity and is no force
    needs a mass, as where it is scored. Of a spring without one the velocity is that of the drive,
    which would follow from itself."""
    try:
        model = members.model
    except ModelError:
        return False
    if any(isinstance(effect, Spring) for _, effect in model) and any(
        "motion" in e.requires and e.place is not Place.MOTION for e in members.effects
    ):
        return False
    needs = tuple(n.removeprefix("channel:") for e in members.effects for n in e.requires)
    return all(model.refusal(effect, needs) is None for effect in members.effects)


def _laws_starts(law: Effect, drive: FloatArray) -> list[dict[str, float]]:
    """Starts for a law's voltages: widths as shares of the drive's range, levels in its middle."""
    low, high = float(drive.min()), float(drive.max())
    asked = {name: p for name, p in law.parameters.items() if not p.fixed}
    found = []
    for share in WIDTHS:
        width = share * (high - low)
        begun = {}
        for name, p in asked.items():
            if p.unit == "1/V" and p.bounds[0] == 0.0:
                begun[f"{law.name}.{name}"] = 1.0 / width
            elif p.unit == "V":
                begun[f"{law.name}.{name}"] = width if p.bounds[0] > 0.0 else 0.5 * (low + high)
        found += [begun] if begun else []
    return found
