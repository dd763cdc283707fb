"""Moments, what they mean, and what may be believed of them. NumPy only: testable without Mitsuba."""

from renderer.estimate.estimate import Estimate, PixelReading
from renderer.estimate.moments import Moments

__all__ = ["Estimate", "Moments", "PixelReading"]
