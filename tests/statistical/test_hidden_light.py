"""Light that arrives through mirrors and clear glass alone: the audit knows of it, and no target counts as reached.

The audit is judged by what camera paths find where they can (a lamp of 10 mm in glass, 2e7 samples), by scaling (a lamp
of the same power and a tenth of the size gives the same light, found a hundred times as seldom), and by light that
needs no glass. Seeds are fixed; the bounds are those of an estimator that is to be right within a factor of two, and
five of its standard errors or more.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import renderer
from renderer import Estimate, Settings, Target
from renderer.audit import run
from renderer.audit.run import audit, is_needed
from renderer.audit.value import Audit
from renderer.backend import mitsuba
from renderer.progress import NOT_AUDITED
from renderer.scene.compile import Scene
from renderer.scene.report import inspect_scene
from tests.coverage_study import hidden_light

T: Any = mitsuba().ScalarTransform4f
SHARED = Path(__file__).parents[3] / "shared" / "scenes"


@pytest.fixture(autouse=True)
def looks_at_brief_renders(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("renderer.progress.BRIEF_SECONDS", 0.0)


def resolved(scene: Scene, **asked: Any) -> Settings:
    return scene.resolved(Settings(**asked), 16)


def audited(scene: Scene, **asked: Any) -> Audit:
    found = audit(scene, resolved(scene, **asked))
    assert found is not None
    return found


def mean_of(found: Audit) -> float:
    return float(found.spectrum.sum(axis=1).mean())


@pytest.fixture(scope="module")
def slab() -> Scene:
    return renderer.load_scene(hidden_light.scene("slab-1mm"))


@pytest.fixture(scope="module")
def slab_audit(slab: Scene) -> Audit:
    return audited(slab)


def test_a_lamp_in_glass_gives_the_light_that_camera_paths_find_in_the_end() -> None:
    # 2e7 samples of technique mis: 0.0563 ± 0.0033.
    found = audited(renderer.load_scene(hidden_light.scene("sphere-10mm")))
    assert mean_of(found) == pytest.approx(0.0563, abs=5 * 0.0033)


def test_a_smaller_lamp_gives_the_same_light_that_is_found_more_seldom(slab_audit: Audit) -> None:
    smaller = audited(renderer.load_scene(hidden_light.scene("slab-0.1mm")))
    assert mean_of(smaller) == pytest.approx(mean_of(slab_audit), rel=0.05)
    assert slab_audit.sources[0].finds / smaller.sources[0].finds == pytest.approx(100.0, rel=0.1)


def test_how_seldom_light_is_found_is_what_a_camera_sees() -> None:
    """A lamp large enough: replicates of one sample that are not black, in a room that has no other light."""
    lamp = hidden_light.lit_by("sphere", 0.08)
    scene = renderer.load_scene(lamp)
    estimate = renderer.render(scene, Target(spp=400), Settings(replicate_size=1, seed=4, adaptive=False))
    found = audited(scene)
    rate = estimate.moments.nonzero.sum() / estimate.moments.count.sum()
    assert found.sources[0].finds == pytest.approx(rate, rel=0.5)  # between mirrors, roulette is not played here
    assert mean_of(found) == pytest.approx(float(estimate.mean.mean()), rel=0.2)


def test_the_sun_through_a_pane_is_met_by_no_sample_and_a_disk_in_its_place_hardly_ever() -> None:
    sun, disk = (audited(renderer.load_scene(hidden_light.scene(f"pane-{light}"))) for light in ("sun", "disk"))
    assert float(sun.never().mean()) == pytest.approx(mean_of(disk), rel=0.3)
    assert sun.sources[0].finds == 0.0
    assert 0 < disk.sources[0].finds < 1e-4


def test_equal_seeds_give_equal_bits_and_other_seeds_the_same_light(slab: Scene, slab_audit: Audit) -> None:
    again, other = audited(slab), audited(slab, seed=7)
    assert again.spectrum.tobytes() == slab_audit.spectrum.tobytes()
    assert other.spectrum.tobytes() != slab_audit.spectrum.tobytes()
    assert mean_of(other) == pytest.approx(mean_of(slab_audit), rel=0.1)


def test_the_order_in_which_lights_and_glass_are_loaded_changes_no_bit() -> None:
    """Mitsuba loads the shapes of a file side by side, and lists them in the order in which they were ready."""
    scene = hidden_light.scene("slab-1mm")
    lamp = next(v for v in scene.values() if isinstance(v, dict) and "emitter" in v)
    for i, power in enumerate((3.0, 7.0, 1.0)):  # two of them at one place
        at = T().translate([0.1 * (i // 2), 0.4, 0.3]).rotate([1, 0, 0], 90).scale(0.002)
        scene[f"more-{i}"] = {**lamp, "to_world": at, "emitter": {"type": "area", "radiance": power}}
        scene[f"glass-{i}"] = {"type": "sphere", "radius": 0.02, "center": [0.1 * i - 0.1, 0.3, 0.3]}
        scene[f"glass-{i}"]["bsdf"] = {"type": "dielectric"}
    other = {"type": "scene"} | dict(reversed(list(scene.items())))
    first, second = (audited(renderer.load_scene(each)) for each in (scene, other))
    assert first.as_dict() == second.as_dict()


def test_the_depth_that_is_asked_for_limits_the_light_that_counts(slab: Scene, slab_audit: Audit) -> None:
    assert not is_needed(slab, resolved(slab, max_depth=2))
    assert mean_of(audited(slab, max_depth=3)) == pytest.approx(0.0, abs=1e-6)  # two sides of the slab
    assert 0 < mean_of(audited(slab, max_depth=4)) < mean_of(slab_audit)


@pytest.mark.parametrize("name", ["slab-1mm", "sphere-1mm", "water", "pane-sun"])
def test_no_target_counts_as_reached_while_light_is_missing(name: str) -> None:
    scene = renderer.load_scene(hidden_light.scene(name))
    for seed in range(3):
        *_, last = renderer.progressive(scene, Target(error=0.25, spp=256), Settings(seed=seed))
        assert last.stopped_by == "spp"
        assert last.upper is None or last.upper > 0.25  # None where not one sample has met any light
        assert last.share_trusted < 0.01
        assert last.health.status == "uncertain"
        assert any("'lamp'" in said or "'sun'" in said for said in last.health.hidden)


def test_files_and_merges_keep_what_the_audit_says(tmp_path: Path, slab: Scene) -> None:
    parts = [renderer.render(slab, Target(spp=64), Settings(seed=seed, width=16)) for seed in (0, 1)]
    merged = renderer.merge(*parts)
    assert merged.audit is not None
    assert merged.audit.batches == 16
    merged.write(tmp_path / "a.exr")
    again = Estimate.read(tmp_path / "a.exr")
    assert again.health == merged.health
    assert not again.trust.any()


def test_a_resumed_render_says_what_a_straight_one_says(slab: Scene) -> None:
    asked = Settings(width=16, replicate_size=16)
    straight = renderer.render(slab, Target(spp=96), asked)
    resumed = renderer.render(slab, Target(spp=96), asked, start=renderer.render(slab, Target(spp=32), asked))
    assert straight.audit is not None
    assert resumed.audit is not None
    assert resumed.audit.spectrum.tobytes() == straight.audit.spectrum.tobytes()
    assert resumed.health == straight.health


@pytest.mark.parametrize("name", ["cornell-box", "gap", "furnace", "many-lights"])
def test_scenes_without_mirrors_and_glass_are_not_audited(name: str) -> None:
    scene = renderer.load_scene(name, settings=Settings(width=32))
    assert not is_needed(scene, resolved(scene, width=32))


@pytest.mark.parametrize("name", ["ring-sky", "shared/cbox-glass-mirror"])
def test_light_that_camera_paths_find_takes_no_trust_and_hardly_any_samples(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = name if not name.startswith("shared/") else SHARED / name.removeprefix("shared/") / "scene.xml"
    if isinstance(source, Path) and not source.is_file():
        pytest.skip(f"{source} is not beside the checkout")
    scene = renderer.load_scene(source, settings=Settings(width=32))
    *_, with_audit = renderer.progressive(scene, Target(error=0.15, spp=2000), Settings(width=32))
    monkeypatch.setattr(Scene, "audit", lambda self, settings: None)
    *_, without = renderer.progressive(scene, Target(error=0.15, spp=2000), Settings(width=32))
    assert with_audit.stopped_by == without.stopped_by  # ring-sky waits for bright values to show, with and without
    assert with_audit.upper is not None
    assert with_audit.upper <= 0.15
    assert with_audit.spp <= 1.35 * without.spp  # a checkpoint or two
    assert with_audit.share_trusted >= without.share_trusted - 0.01


def test_a_light_that_no_technique_samples_is_audited_without_glass() -> None:
    """Technique bsdf: a small lamp in plain sight is as hard to find as one behind a pane."""
    scene = renderer.load_scene(hidden_light.bare(0.001))
    assert not is_needed(scene, resolved(scene))
    found = audited(scene, technique="bsdf")
    truth = renderer.render(scene, Target(spp=64), Settings(seed=1))
    assert mean_of(found) == pytest.approx(float(truth.mean.mean()), rel=0.2)
    assert found.sources[0].via == ""


@pytest.mark.parametrize("kind", ["frosted", "ground"])
def test_light_that_goes_on_through_frosted_glass_is_found(kind: str) -> None:
    """From a lamp behind clear glass to a rough side that sends it through: arrivals count from either side."""
    truth = renderer.render(
        hidden_light.findable(f"{kind}-1mm"), Target(spp=2048), Settings(16, 16, 3, adaptive=False, replicate_size=16)
    )
    assert mean_of(audited(renderer.load_scene(hidden_light.scene(f"{kind}-1mm")))) == pytest.approx(
        float(truth.mean.mean()), rel=0.35
    )


def test_a_view_into_a_small_part_of_what_is_lit_is_not_believed_though_each_tile_alone_is_noise() -> None:
    scene = renderer.load_scene(hidden_light.scene("zoomed-1mm+"))
    found = audited(scene)
    assert float(found.found().mean()) > 0.3 * mean_of(found)
    *_, last = renderer.progressive(scene, Target(error=0.25, spp=256), Settings(replicate_size=4, adaptive=False))
    assert last.stopped_by == "spp"
    assert last.share_trusted < 0.02


def test_mirrors_and_glass_far_apart_are_each_aimed_at() -> None:
    """The sun through a window, with a ball of glass a hundred windows away: as without the ball."""
    parts = hidden_light.scene("pane-sun")
    alone = mean_of(audited(renderer.load_scene(parts)))
    crystal = {"type": "sphere", "center": [100, 100, 0], "radius": 1, "bsdf": {"type": "dielectric"}}
    both = audited(renderer.load_scene(parts | {"crystal": crystal}))
    assert mean_of(both) == pytest.approx(alone, rel=0.1)
    assert float(both.found().mean()) > 0.7 * mean_of(both)


@pytest.mark.parametrize("name", ["slab-1mm", "sphere-1mm", "mirror-1mm", "pane-sun", "pane-disk", "water"])
def test_inspect_names_lights_behind_glass(name: str) -> None:
    said = [w for w in inspect_scene(hidden_light.scene(name))["warnings"] if w.startswith("light behind glass")]
    assert len(said) == 1
    assert ("'sun'" if name.startswith("pane") else "'lamp'") in said[0]


def test_inspect_names_lights_behind_glass_that_instances_place() -> None:
    assert "'lamp'" in " ".join(inspect_scene(hidden_light.instanced("sphere-1mm"))["warnings"])


@pytest.mark.parametrize("plugin", ["orthographic", "irradiancemeter"])
def test_inspect_looks_through_every_kind_of_sensor(plugin: str) -> None:
    """An orthographic camera through glass: its rays have one direction."""
    parts = hidden_light.scene("water")
    if plugin == "orthographic":
        above = T().look_at([0, 0, 0.4], [0, 0, -1], [0, 1, 0])
        parts["sensor"] = {"type": plugin, "to_world": above, "film": parts["sensor"]["film"]}
    else:
        film = parts.pop("sensor")["film"]
        low = T().translate([0, 0, -0.9]).scale(0.3)
        parts["plate"] = {"type": "rectangle", "to_world": low, "meter": {"type": plugin, "film": film}}
    assert "'lamp'" in " ".join(inspect_scene(parts)["warnings"])


@pytest.mark.parametrize("scene", ["glass-sky", "materials", "large lamp", "plain lamp"])
def test_inspect_says_nothing_of_lights_that_are_found(scene: str) -> None:
    others = {"large lamp": hidden_light.lit_by("slab", 0.3), "plain lamp": hidden_light.bare(0.001)}
    assert "behind glass" not in " ".join(inspect_scene(others.get(scene, scene))["warnings"])


def test_instances_of_glass_count_as_glass() -> None:
    """A lamp inside a hollow ball of glass that an instance places, instead of one that the scene holds itself."""
    plain = renderer.load_scene(hidden_light.scene("sphere-10mm"))
    placed = renderer.load_scene(hidden_light.instanced("sphere-10mm"))
    assert is_needed(placed, resolved(placed))
    assert mean_of(audited(placed)) == pytest.approx(mean_of(audited(plain)), rel=0.1)


def test_the_audit_of_every_colour_model_agrees() -> None:
    means = []
    for colour in ("mono", "rgb", "spectral"):
        scene = renderer.load_scene(hidden_light.scene("slab-10mm"), settings=Settings(colour=colour))
        means.append(mean_of(audited(scene, colour=colour)))
    assert np.allclose(means, means[0], rtol=0.1)


def test_what_an_audit_says_is_dropped_where_it_is_noise(slab_audit: Audit) -> None:
    noisy = replace(slab_audit, m2=1e6 * slab_audit.m2 + 1.0, m2_coarse=1e6 * slab_audit.m2_coarse + 1.0)
    assert noisy.is_empty


def test_a_brief_render_that_asks_for_no_error_is_not_kept_waiting(
    slab: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("renderer.progress.BRIEF_SECONDS", 1e9)
    brief = renderer.render(slab, Target(spp=16), Settings(width=16))
    assert brief.audit is None
    assert NOT_AUDITED in brief.health.warnings
    asked = renderer.render(slab, Target(spp=64, error=0.25), Settings(width=16))
    assert asked.audit is not None
    assert NOT_AUDITED not in asked.health.warnings
    resumed = renderer.render(slab, Target(spp=96), Settings(width=16), start=asked)
    assert resumed.audit is not None


def test_a_time_that_leaves_none_for_an_audit_is_kept_and_no_target_counts_as_reached(
    slab: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A picture that looks good, and a time of which an audit would take all: it goes on to its end, and says so."""
    monkeypatch.setattr("renderer.progress.AUDIT_SECONDS", 1e9)
    monkeypatch.setattr("renderer.stopping.StopRule.is_reached", lambda self, found: True)
    *_, last = renderer.progressive(slab, Target(error=0.5, seconds=0.5), Settings(width=16))
    assert last.stopped_by == "seconds"
    assert last.estimate.audit is None
    assert NOT_AUDITED in last.health.warnings


def test_no_word_of_audits_where_there_is_nothing_to_look_for() -> None:
    assert renderer.render("cornell-box", Target(spp=4), Settings(width=16)).health.warnings == ()


@pytest.mark.parametrize(
    ("name", "is_whole"),
    [("materials", False), ("slab-1mm", True), ("sphere-0.1mm", True), ("pane-sun", True), ("zoomed-1mm+", True)],
)
def test_an_eighth_of_the_paths_is_enough_where_nothing_hides(
    name: str, is_whole: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []
    looked = run._looked

    def noted(*arguments: Any) -> Any:
        asked.append(arguments[-1])
        return looked(*arguments)

    monkeypatch.setattr(run, "_looked", noted)
    source = name if name == "materials" else hidden_light.scene(name)
    audited(renderer.load_scene(source, settings=Settings(width=32)), width=32)
    assert asked == ([run.FEWER, 1] if is_whole else [run.FEWER])
