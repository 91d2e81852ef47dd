"""Black-box linear models: transfer functions, frequency responses, order reduction."""

from piezo_opt.linear_models.criteria import StepCriteria, step_criteria
from piezo_opt.linear_models.fitting import OrderRow, OrderSearch, fit_transfer, search_orders
from piezo_opt.linear_models.frequency import FrequencyResponse, frequency_response
from piezo_opt.linear_models.judging import judge
from piezo_opt.linear_models.modal import ModalModel
from piezo_opt.linear_models.modal_files import read_axes_model
from piezo_opt.linear_models.modal_fit import ModalFit, fit_modes
from piezo_opt.linear_models.modal_identify import AxesFit, identify_axes
from piezo_opt.linear_models.modal_judging import AxesError, LevelError, axes_error
from piezo_opt.linear_models.question import Detrend, LinearQuestion
from piezo_opt.linear_models.reduction import (
    Reduced,
    SecondOrderShape,
    second_order_shape,
    truncate,
    two_poles_like,
)
from piezo_opt.linear_models.response_matrix import ResponseMatrix, response_matrix
from piezo_opt.linear_models.transfer import TransferFit

__all__ = [
    "AxesError",
    "AxesFit",
    "Detrend",
    "FrequencyResponse",
    "LevelError",
    "LinearQuestion",
    "ModalFit",
    "ModalModel",
    "OrderRow",
    "OrderSearch",
    "Reduced",
    "ResponseMatrix",
    "SecondOrderShape",
    "StepCriteria",
    "TransferFit",
    "axes_error",
    "fit_modes",
    "fit_transfer",
    "frequency_response",
    "identify_axes",
    "judge",
    "read_axes_model",
    "response_matrix",
    "search_orders",
    "second_order_shape",
    "step_criteria",
    "truncate",
    "two_poles_like",
]
