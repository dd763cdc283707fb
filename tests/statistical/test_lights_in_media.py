"""Lights chosen by place where there are media: less variance, the same mean, and points in media that see lights."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import renderer
from renderer.backend import mitsuba, using

LAMPS, SIDE, REPLICATES = 24, 16, 24


def lamps_in_fog() -> dict[str, Any]:
    """Small lamps in a cube of fog above a floor, seen from outside."""
    at = mitsuba().ScalarTransform4f
    rng = np.random.default_rng(2)
    fog = {"type": "homogeneous", "id": "fog", "sigma_t": 0.4, "albedo": 0.9}
    film = {"type": "hdrfilm", "width": SIDE, "height": SIDE, "filter": {"type": "box"}}
    scene = {
        "type": "scene",
        "integrator": {"type": "volpath", "max_depth": 4},
        "sensor": {"type": "perspective", "to_world": at().look_at([0, 0, 6], [0, 0, 0], [0, 1, 0]), "film": film},
        "cloud": {"type": "cube", "to_world": at().scale(2.0), "bsdf": {"type": "null"}, "interior": fog},
        "floor": {
            "type": "rectangle",
            "to_world": at().translate([0, -1.9, 0]).rotate([1, 0, 0], -90).scale(1.9),
            "bsdf": {"type": "diffuse"},
        },
    }
    for i in range(LAMPS):
        light = {"type": "area", "radiance": {"type": "rgb", "value": [float(x) for x in rng.uniform(20, 60, 3)]}}
        centre = [float(x) for x in rng.uniform(-1.8, 1.8, 3)]
        scene[f"lamp{i}"] = {"type": "sphere", "center": centre, "radius": 0.03, "light": light}
    return scene


def test_lights_in_media_are_chosen_by_place() -> None:
    scene = renderer.load_scene(lamps_in_fog())
    model = scene.model(scene.resolved(renderer.Settings(), 16))
    pixels = np.tile(np.arange(SIDE**2), REPLICATES)
    replicates = np.repeat(np.arange(REPLICATES), SIDE**2)
    found = {}
    for by_place in (True, False):
        kernel = scene.kernel_of(replace(model, surveys_lights=by_place))
        assert kernel.emitters.knows_places == by_place
        radiance, invalid, _ = kernel.launch(pixels, replicates, 3)
        assert not np.any(invalid)
        found[by_place] = np.array(radiance)[1].reshape(REPLICATES, -1)
    place, power = found[True], found[False]
    variance = [each.var(0, ddof=1) / np.maximum(power.mean(0), 0.05) ** 2 for each in (place, power)]
    assert 2 * np.median(variance[0]) < np.median(variance[1])
    error = np.sqrt((place.var(0, ddof=1) + power.var(0, ddof=1)).sum() / REPLICATES) / SIDE**2
    assert abs(place.mean() - power.mean()) < 4 * error


def test_points_in_media_are_surveyed_through_their_borders() -> None:
    scene = renderer.load_scene(lamps_in_fog())
    with using(scene.variant):
        from renderer.equation.lights.sampler import useful_survey
        from renderer.equation.lights.scene_lights import lights_of

        seen = useful_survey(scene.mitsuba_scene, scene.sensor, lights_of(scene.mitsuba_scene), True)
    assert seen is not None
    within = ~seen.features[:, 3:].any(axis=1)
    assert 0.2 < within.mean() < 0.95
    places = scene.similarity.original_position(seen.features[within, :3] * seen.size + seen.centre)
    assert (np.abs(places) <= 2.001).all()
    # Nothing but a lamp hides another one from a point in the air.
    assert (seen.given[within] > 0).mean() > 0.95
