"""Optimal identification, diagnosis and control of piezoelectric actuators.

The front door, in the order of the work: read a record, write the physics as a sum of effects,
ask a question, solve it, compare, learn what is missing, add it, report.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from piezo_opt import effects, physics, signals
    from piezo_opt.comparison import Comparison, compare, uncontrolled_iae
    from piezo_opt.control import (
        MPC,
        PID,
        Limits,
        ModelPlant,
        close_loop,
        linearise,
        margins,
        optimal_feedforward,
        tune_lqr,
        tune_mpc,
        tune_pid,
        tune_shaper,
    )
    from piezo_opt.datasets import load, load_campaign
    from piezo_opt.diagnosis import Diagnosis, Effort, diagnose
    from piezo_opt.effects import Effect, Model
    from piezo_opt.errors import InputError, ModelError, PiezoOptError
    from piezo_opt.export import export_arduino, export_c, export_controller, export_fmu
    from piezo_opt.identification import (
        Bootstrap,
        CmaEs,
        Collocation,
        DifferentialEvolution,
        Fatrop,
        Fit,
        Identification,
        Ipopt,
        LevenbergMarquardt,
        Loss,
        MultipleShooting,
        NelderMead,
        Prior,
        Profile,
        Profiles,
        ScipyLeastSquares,
        Shape,
        SingleShooting,
        Sqp,
        Start,
        as_driven,
        bootstrap,
        default_model,
        load_fit,
        priors_from,
        profile_likelihood,
        save_fit,
        solve,
    )
    from piezo_opt.linear_models import (
        AxesFit,
        Detrend,
        ModalModel,
        TransferFit,
        axes_error,
        fit_modes,
        fit_transfer,
        frequency_response,
        identify_axes,
        read_axes_model,
        response_matrix,
        search_orders,
    )
    from piezo_opt.measurement import (
        AxesCampaign,
        AxesRecord,
        Between,
        Campaign,
        Check,
        Measurement,
        check,
    )
    from piezo_opt.readers import read, read_axes, read_campaign, write
    from piezo_opt.report import write_report
    from piezo_opt.simulation import Initial, Many, Response, simulate, simulate_many
    from piezo_opt.studies import study_thesis, study_worth
    from piezo_opt.units import quantity
    from piezo_opt.values import Values
    from piezo_opt.video import Track, track

__version__ = "0.1.0"

__all__ = [
    "MPC",
    "PID",
    "AxesCampaign",
    "AxesFit",
    "AxesRecord",
    "Between",
    "Bootstrap",
    "Campaign",
    "Check",
    "CmaEs",
    "Collocation",
    "Comparison",
    "Detrend",
    "Diagnosis",
    "DifferentialEvolution",
    "Effect",
    "Effort",
    "Fatrop",
    "Fit",
    "Identification",
    "Initial",
    "InputError",
    "Ipopt",
    "LevenbergMarquardt",
    "Limits",
    "Loss",
    "Many",
    "Measurement",
    "ModalModel",
    "Model",
    "ModelError",
    "ModelPlant",
    "MultipleShooting",
    "NelderMead",
    "PiezoOptError",
    "Prior",
    "Profile",
    "Profiles",
    "Response",
    "ScipyLeastSquares",
    "Shape",
    "SingleShooting",
    "Sqp",
    "Start",
    "Track",
    "TransferFit",
    "Values",
    "as_driven",
    "axes_error",
    "bootstrap",
    "check",
    "close_loop",
    "compare",
    "default_model",
    "diagnose",
    "effects",
    "export_arduino",
    "export_c",
    "export_controller",
    "export_fmu",
    "fit_modes",
    "fit_transfer",
    "frequency_response",
    "identify_axes",
    "linearise",
    "load",
    "load_campaign",
    "load_fit",
    "margins",
    "optimal_feedforward",
    "physics",
    "priors_from",
    "profile_likelihood",
    "quantity",
    "read",
    "read_axes",
    "read_axes_model",
    "read_campaign",
    "response_matrix",
    "save_fit",
    "search_orders",
    "signals",
    "simulate",
    "simulate_many",
    "solve",
    "study_thesis",
    "study_worth",
    "track",
    "tune_lqr",
    "tune_mpc",
    "tune_pid",
    "tune_shaper",
    "uncontrolled_iae",
    "write",
    "write_report",
]

_ROOMS: Final = {
    "comparison": "Comparison compare uncontrolled_iae",
    "control": (
        "Limits MPC ModelPlant PID close_loop linearise margins optimal_feedforward tune_lqr "
        "tune_mpc tune_pid tune_shaper"
    ),
    "datasets": "load load_campaign",
    "diagnosis": "Diagnosis Effort diagnose",
    "effects": "Effect Model",
    "errors": "InputError ModelError PiezoOptError",
    "export": "export_arduino export_c export_controller export_fmu",
    "identification": (
        "Bootstrap CmaEs Collocation DifferentialEvolution Fatrop Fit Identification Ipopt "
        "LevenbergMarquardt Loss MultipleShooting NelderMead Prior Profile Profiles "
        "ScipyLeastSquares Shape SingleShooting Sqp Start as_driven bootstrap default_model "
        "load_fit priors_from profile_likelihood save_fit solve "
    ),
    "linear_models": (
        "AxesFit Detrend ModalModel TransferFit axes_error fit_modes fit_transfer "
        "frequency_response identify_axes read_axes_model response_matrix search_orders"
    ),
    "measurement": "AxesCampaign AxesRecord Between Campaign Check Measurement check",
    "readers": "read read_axes read_campaign write",
    "report": "write_report",
    "simulation": "Initial Many Response simulate simulate_many",
    "studies": "study_thesis study_worth",
    "units": "quantity",
    "values": "Values",
    "video": "Track track",
}
_ROOM_OF: Final = {name: room for room, names in _ROOMS.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    """A public name or a room, loaded when somebody asks for it.

    Raises `AttributeError` for a name that the package does not have.
    """
    where = f"{__name__}.{_ROOM_OF.get(name, name)}"
    try:
        found = None if name.startswith("_") else import_module(where)
    except ModuleNotFoundError as error:
        if error.name != where:
            raise
        found = None
    if found is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = getattr(found, name) if name in _ROOM_OF else found
    return globals()[name]


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
