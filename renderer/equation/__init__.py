"""The rendering equation's estimator: one kernel, its sampling techniques and its random numbers."""

from renderer.backend import mitsuba

mitsuba()  # before any module here imports Dr.Jit, which looks for libLLVM as soon as it is imported
