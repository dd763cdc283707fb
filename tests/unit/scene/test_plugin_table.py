"""One row a plugin: the table knows all of Mitsuba's, and says of them what Mitsuba says."""

from __future__ import annotations

from pathlib import Path

import pytest

from renderer.backend import mitsuba, using
from renderer.scene.plugins import PLUGINS, TRAITS, by_class, having, of_kind

# Libraries that no scene may name: Mitsuba's own helpers, and what reads other programs' memory.
NOT_FOR_SCENES = {"blender", "merge"}
VARIANT = "llvm_ad_rgb"


def test_every_trait_is_documented_and_held_by_some_plugin() -> None:
    assert {trait for row in PLUGINS.values() for trait in row.traits} == TRAITS.keys()
    assert all(having(trait) for trait in TRAITS)
    with pytest.raises(KeyError, match="shiny"):
        having("shiny")


def test_all_of_mitsuba_s_plugins_have_a_row() -> None:
    folder = Path(str(mitsuba().__file__)).parent / "plugins"
    built = {path.stem for path in folder.iterdir() if path.suffix in (".so", ".dll", ".dylib")}
    lacks = {name for name in built - PLUGINS.keys() - NOT_FOR_SCENES if not name.startswith("lib")}
    assert built, "there is something to compare with"
    assert not lacks


@pytest.mark.parametrize("name", sorted(of_kind("BSDF") - having("tensor") - having("wraps")))
def test_a_bsdf_has_the_lobes_that_its_row_says(name: str) -> None:
    mi = mitsuba()
    with using(VARIANT):
        flags = int(mi.load_dict({"type": name}).flags())
    kinds, traits = mi.BSDFFlags, PLUGINS[name].traits
    delta = int(kinds.DeltaReflection | kinds.DeltaTransmission)
    # Hair calls a lobe null and never draws from it.
    assert not flags & int(kinds.Null) or "null" in traits or name == "hair"
    assert not flags & int(kinds.Transmission) or "transmits" in traits
    assert not flags & delta or "delta" in traits
    assert not flags & int(kinds.Smooth) or "smooth" in traits


@pytest.mark.parametrize("name", ["point", "spot", "directional", "constant", "sunsky", "timed_sunsky"])
def test_an_emitter_is_of_the_class_and_kind_that_its_row_says(name: str) -> None:
    mi = mitsuba()
    with using(VARIANT):
        emitter = mi.load_dict({"type": name})
        flags = int(emitter.flags())
    row = by_class()[emitter.class_name()]
    assert (row.name, row.kind) == (name, "Emitter")
    assert bool(flags & int(mi.EmitterFlags.Delta)) == ("delta" in row.traits)
    assert bool(emitter.is_environment()) == ("environment" in row.traits)


def test_rows_are_of_one_kind_each() -> None:
    assert sum(len(of_kind(kind)) for kind in {row.kind for row in PLUGINS.values()}) == len(PLUGINS)
    assert of_kind("Shape") >= having("area") | having("grows") - {"constvolume"}
