"""Properties that are made at first use and kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, Self, TypeVar, final, overload

_Value = TypeVar("_Value")


@final
class lazy(Generic[_Value]):
    """A property that is made at first use and kept, for what threads share.

    As ``functools.cached_property`` from Python 3.12 on. Before, that one holds a lock for all
    instances of a class while it makes one: whoever asks another instance waits meanwhile, for a
    compiler even, and two such locks may wait for each other. Here two threads that ask for the
    same at once may both make it; all go on with the first.
    """

    def __init__(self, make: Callable[[Any], _Value]) -> None:
        self._make = make
        self._name = make.__name__
        self.__doc__ = make.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...

    @overload
    def __get__(self, instance: object, owner: type) -> _Value: ...

    def __get__(self, instance: object | None, owner: type) -> Self | _Value:
        if instance is None:
            return self
        kept: dict[str, _Value] = instance.__dict__
        return kept.setdefault(self._name, self._make(instance))
