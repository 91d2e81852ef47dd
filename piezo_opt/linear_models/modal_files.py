"""A modal model from the file that a fit wrote."""

from __future__ import annotations

import json
import os

from piezo_opt.errors import InputError
from piezo_opt.files import checked
from piezo_opt.linear_models.modal import ModalModel


def read_axes_model(path: str | os.PathLike[str]) -> ModalModel:
    """The model of the JSON that ``piezo-opt axes fit`` writes, or of `ModalModel.to_dict`.

    Raises:
        InputError: no such file, or no such model in it.
    """
    file = checked(path)
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(
            f"{file}: is no JSON: give what 'piezo-opt axes fit --json' wrote"
        ) from error
    if not isinstance(data, dict):
        raise InputError(f"{file}: holds no model: give what 'piezo-opt axes fit --json' wrote")
    try:
        return ModalModel.from_dict(data.get("model", data))
    except (InputError, AttributeError) as error:
        raise InputError(f"{file}: {error}: give what 'piezo-opt axes fit --json' wrote") from error
