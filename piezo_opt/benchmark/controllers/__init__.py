"""What controllers cost and find: iterations beside solvers, gradients beside a simplex, draws."""

from piezo_opt.benchmark.controllers.bench import ControlBench, control_bench

__all__ = ["ControlBench", "control_bench"]
