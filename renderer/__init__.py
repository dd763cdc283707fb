"""Fredholm's renderer: solves the rendering equation over Mitsuba 3 scenes by Monte Carlo, and says how well.

    import renderer
    estimate = renderer.render("cornell-box", renderer.Target(error=0.05))
    print(estimate.pixel(256, 256))
    estimate.write("out.exr")

Importing this package imports neither Mitsuba nor any HTTP code.
"""

from renderer import backend, errors
from renderer.camera import Camera
from renderer.estimate.estimate import Estimate, PixelReading, merge
from renderer.estimate.forecast import CurvePoint, Forecast
from renderer.estimate.health import Health
from renderer.integral import Integral, integrate
from renderer.part import passes
from renderer.progress import Snapshot, progressive, render
from renderer.region import Region
from renderer.replay import Replay, replay
from renderer.scene import gallery
from renderer.scene.compile import Scene, load_scene
from renderer.scene.parameters import SceneFile
from renderer.series import Member, series
from renderer.settings import Settings, Target

backend.choose_llvm()  # Dr.Jit looks for it when it is imported, which a caller may do next

__all__ = [
    "Camera",
    "CurvePoint",
    "Estimate",
    "Forecast",
    "Health",
    "Integral",
    "Member",
    "PixelReading",
    "Region",
    "Replay",
    "Scene",
    "SceneFile",
    "Settings",
    "Snapshot",
    "Target",
    "errors",
    "gallery",
    "integrate",
    "load_scene",
    "merge",
    "passes",
    "progressive",
    "render",
    "replay",
    "series",
]
