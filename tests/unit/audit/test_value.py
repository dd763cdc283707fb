"""Facts about the audit as a value: it merges, it is read back, and it says what samples must have missed."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from renderer.audit.missing import missing_of
from renderer.audit.value import CLASSES, Audit, Source, class_of, sentences, worths
from renderer.estimate.moments import Moments

RNG = np.random.default_rng(3)


def audit(energy: float = 1.0, worth: float = 1e4, *, batches: int = 8, m2: float = 0.0, side: int = 8) -> Audit:
    """Light of one class, alike in all four tiles of a square image."""
    spectrum = np.zeros((4, CLASSES + 1))
    spectrum[:, class_of(np.array([worth]))[0]] = energy
    source = Source("'lamp'", "'water'", energy, 0.0 if np.isinf(worth) else energy / worth)
    return Audit(side, side, 2, 2, batches, spectrum, np.full(4, m2), (source,))


def moments(values: np.ndarray) -> Moments:
    """(replicates, pixels) grey values."""
    made = Moments.empty(values.shape[1])
    for row in values:
        made.add(slice(None), np.repeat(row[:, None], 3, axis=1).astype(np.float32), np.zeros(len(row), np.uint32), 16)
    return made


def settled(mean: float = 1.0, replicates: int = 20, pixels: int = 64) -> Moments:
    return moments(mean * RNG.uniform(0.9, 1.1, (replicates, pixels)))


def test_the_class_of_the_middle_of_a_class_is_that_class() -> None:
    assert (class_of(worths()) == np.arange(CLASSES + 1)).all()


def test_merging_is_that_of_all_batches_together() -> None:
    batches = RNG.random((8, 4))  # totals of each batch and tile

    def of(part: np.ndarray) -> Audit:
        spectrum = np.zeros((4, CLASSES + 1))
        spectrum[:, 5] = part.mean(axis=0)
        return replace(
            audit(), batches=len(part), spectrum=spectrum, m2=np.square(part - part.mean(axis=0)).sum(axis=0)
        )

    merged, straight = of(batches[:3]).merge(of(batches[3:])), of(batches)
    assert merged.batches == straight.batches
    np.testing.assert_allclose(merged.spectrum, straight.spectrum, rtol=1e-12)
    np.testing.assert_allclose(merged.m2, straight.m2, rtol=1e-12)


def test_merging_sources_weighs_them_by_batches() -> None:
    (source,) = audit(1.0, batches=2).merge(audit(4.0, batches=6)).sources
    assert source.energy == pytest.approx(3.25)


def test_it_is_read_back_bit_for_bit() -> None:
    made = replace(audit(m2=0.1), spectrum=RNG.random((4, CLASSES + 1)) * (RNG.random(CLASSES + 1) < 0.3))
    again = Audit.from_dict(json.loads(json.dumps(made.as_dict())))
    assert again.spectrum.tobytes() == made.spectrum.tobytes()
    assert again.m2.tobytes() == made.m2.tobytes()
    assert (again.sources, again.batches, again.columns) == (made.sources, made.batches, made.columns)


def test_tiles_and_pixels_agree_where_sizes_do_not_divide() -> None:
    made = replace(audit(), width=7, height=5, columns=3, rows=2, spectrum=np.zeros((6, CLASSES + 1)), m2=np.zeros(6))
    values = RNG.random(6)
    np.testing.assert_allclose(made.by_tile(made.by_pixel(values)), values)
    assert made.pixels_per_tile().sum() == 35


def test_light_that_few_samples_meet_is_missing_and_with_many_it_is_not() -> None:
    made = audit(energy=1.0, worth=1e4)
    assert made.missing(np.full(4, 100.0)) == pytest.approx(1.0)
    assert made.missing(np.full(4, 1e7)) == pytest.approx(0.0)


def test_what_may_be_noise_of_the_audit_is_not_held_against_an_image() -> None:
    assert audit(energy=1.0, m2=8 * 7 * 4.0).is_empty  # a standard error of 2
    assert missing_of(audit(energy=1.0, m2=8 * 7 * 4.0), settled(), 16).doubted is None


def test_an_image_that_has_not_met_its_light_is_neither_good_nor_trusted() -> None:
    found = missing_of(audit(energy=1.0, worth=1e6), settled(mean=0.01), 16)
    assert found.doubted is not None
    assert found.doubted.all()
    assert found.squared == pytest.approx(1.0, abs=0.1)  # all of the image
    assert 1.0 < found.at_most < 5.0  # 2 % of such pictures have met a find: this one has not, with 95 % confidence


def test_finds_that_the_picture_may_hold_count_for_its_bound_with_all_that_they_bring() -> None:
    found = missing_of(audit(energy=1.0, worth=1e4), settled(mean=0.01), 16)  # two in the image of 320 samples a pixel
    assert found.at_most > 45.0  # twice the expected 26: there may be five of them, where two and a half are expected


def test_light_that_can_never_be_met_is_an_error_of_its_own_size_for_good() -> None:
    one, more = (missing_of(audit(energy=0.1, worth=np.inf), settled(1.0, n), 16).squared for n in (20, 2000))
    assert one == pytest.approx(0.01, rel=0.1)
    assert more == pytest.approx(one, rel=0.05)


def test_light_that_is_found_often_takes_nothing_from_an_image() -> None:
    found = missing_of(audit(energy=0.5, worth=1.0), settled(1.0, 200), 16)
    assert found.doubted is None
    assert found.squared < 1e-3


def test_hidden_light_that_hardly_matters_takes_no_trust() -> None:
    assert missing_of(audit(energy=1e-4, worth=1e6), settled(1.0, 20), 16).doubted is None


def test_only_the_tiles_with_hidden_light_are_doubted() -> None:
    made = audit(energy=1.0, worth=1e6)
    spectrum = made.spectrum.copy()
    spectrum[1:] = 0
    doubted = missing_of(replace(made, spectrum=spectrum), settled(), 16).doubted
    assert doubted is not None
    image = doubted.reshape(8, 8)
    assert image[:4, :4].all()
    assert image.sum() == 16


def test_an_error_counts_in_the_region_alone() -> None:
    made = audit(energy=1.0, worth=1e6)
    spectrum = made.spectrum.copy()
    spectrum[1:] = 0
    elsewhere = np.zeros((8, 8), bool)
    elsewhere[4:, 4:] = True
    assert missing_of(replace(made, spectrum=spectrum), settled(), 16, elsewhere.ravel()).squared == 0.0


def test_an_image_with_less_light_than_the_audit_is_sure_of_is_doubted_however_many_samples_it_has() -> None:
    found = missing_of(audit(energy=1.0, worth=1.0), settled(mean=0.1, replicates=500), 16)
    assert found.doubted is not None
    assert found.doubted.all()
    assert found.squared > 0.3


def test_without_an_audit_nothing_is_missing() -> None:
    assert missing_of(None, settled(), 16).squared == 0.0


def test_sentences_name_the_light_the_way_and_how_rare_it_is() -> None:
    (said,) = sentences(audit(energy=1.0, worth=12_345.0), 1.0, 64.0)
    assert said == (
        "light from 'lamp' arrives through 'water' and is met by one sample in 12,000; "
        "expect fireflies or a caustic layer"
    )
    (said,) = sentences(audit(energy=1.0, worth=np.inf), 1.0, 64.0)
    assert "met by no sample" in said


def test_nothing_is_said_of_light_that_is_met_often_enough_or_hardly_matters() -> None:
    assert sentences(audit(energy=1.0, worth=50.0), 1.0, 64.0) == ()
    assert sentences(audit(energy=1.0, worth=12_345.0), 1.0, 1e6) == ()
    assert sentences(audit(energy=0.001, worth=1e6), 1.0, 64.0) == ()


def test_rare_light_is_the_brightest_that_few_samples_find() -> None:
    spectrum = np.zeros((4, CLASSES + 1))
    for worth, energy in ((np.inf, 0.5), (1e4, 1.0), (1e1, 3.0)):
        spectrum[:, class_of(np.array([worth]))[0]] = energy
    found = replace(audit(), spectrum=spectrum)
    np.testing.assert_allclose(found.rare(1e-3), 1.5)  # 1/10,000 of the samples find the second, a third the last
    np.testing.assert_allclose(found.rare(1e-6), 0.5)
