"""What the commands write: asked for before long work starts, whole or not at all."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from piezo_opt.errors import InputError
from piezo_opt.readers.files import replacing


def check(paths: Mapping[str, Path | None], *, overwrite: bool) -> None:
    """Refuse outputs, by option, that exist, have no folder, or take each other's place."""
    seen: dict[Path, str] = {}
    for option, path in paths.items():
        if path is None:
            continue
        if path.is_dir():
            raise InputError(f"{option} {path}: is a directory: name a file in it")
        if not path.parent.is_dir():
            raise InputError(f"{option} {path}: there is no folder {path.parent}: make it first")
        if path.exists() and not overwrite:
            raise InputError(
                f"{option} {path}: exists already: choose another name or give --overwrite"
            )
        where = path.resolve()
        if where in seen:
            raise InputError(f"{option} and {seen[where]} are the same file {path}: give two")
        seen[where] = option


def write_json(path: Path, data: Mapping[str, Any], *, overwrite: bool) -> None:
    """Plain data to a file; numbers that are not finite become null, as JSON has none."""
    with replacing(path, overwrite=overwrite) as temporary:
        text = json.dumps(_finite(data), indent=2, allow_nan=False)
        temporary.write_text(text + "\n", encoding="utf-8")


def _finite(data: Any) -> Any:
    if isinstance(data, Mapping):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data
