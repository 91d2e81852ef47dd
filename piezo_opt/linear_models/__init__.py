"""Black-box linear models: transfer functions, frequency responses, order reduction."""

from piezo_opt.linear_models.criteria import StepCriteria, step_criteria
from piezo_opt.linear_models.fitting import OrderRow, OrderSearch, fit_transfer, search_orders
from piezo_opt.linear_models.frequency import FrequencyResponse, frequency_response
from piezo_opt.linear_models.judging import judge
from piezo_opt.linear_models.question import Detrend, LinearQuestion
from piezo_opt.linear_models.reduction import (
    Reduced,
    SecondOrderShape,
    second_order_shape,
    truncate,
    two_poles_like,
)
from piezo_opt.linear_models.transfer import TransferFit

__all__ = [
    "Detrend",
    "FrequencyResponse",
    "LinearQuestion",
    "OrderRow",
    "OrderSearch",
    "Reduced",
    "SecondOrderShape",
    "StepCriteria",
    "TransferFit",
    "fit_transfer",
    "frequency_response",
    "judge",
    "search_orders",
    "second_order_shape",
    "step_criteria",
    "truncate",
    "two_poles_like",
]
