"""Plain diffuse surfaces, worked out here instead of by a call to their plugins: most surfaces of most scenes.

Enters: the BSDFs of a scene. Leaves: which of them reflect by Lambert's law with the same reflectance everywhere, told
from what they answer, and that reflectance on either side. Not in spectral variants, where it depends on wavelengths.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from renderer.backend import mitsuba
from renderer.equation.mueller import depolarised, intensity
from renderer.equation.tables import registry_id, table

mi: Any = mitsuba()

PROBES = 8  # directions asked of each side
TOLERANCE = 1e-5


class Matte:
    """bsdfs: those of a scene; is_complete: whether no surface has another, as parts of instances have. `is_empty`
    where none is plain, `are_all` where every one is.
    """

    def __init__(self, bsdfs: list[Any], is_complete: bool = True) -> None:
        bsdfs = list({registry_id(bsdf): bsdf for bsdf in bsdfs if bsdf is not None}.values())
        candidates = [] if mi.is_spectral else [bsdf for bsdf in bsdfs if _may_be_plain(bsdf)]
        plain = {i: sides for i, sides in _reflectances(candidates).items() if sides is not None}
        self.is_empty = not plain
        self.are_all = is_complete and len(plain) == len(bsdfs)
        if self.is_empty:
            return
        self.beyond = max(map(registry_id, bsdfs)) + 1  # a row of nothing, for all that is not listed
        rows = np.zeros((self.beyond + 1, 2, 4), np.float32)
        for i, (front, back) in plain.items():
            rows[i, 0, :3], rows[i, 1, :3], rows[i, :, 3] = front, back, 1
        self._rows = table(rows.ravel(), mi.Float)

    def eval_pdf_sample(
        self, bsdf: Any, ctx: Any, si: Any, wo: Any, u_lobe: Any, u: Any, active: Any
    ) -> tuple[Any, ...]:
        """As Mitsuba's BSDF of that name, for all surfaces."""
        if self.is_empty:
            return bsdf.eval_pdf_sample(ctx, si, wo, u_lobe, u, active)
        reflectance, side, is_plain = self._reflectance(bsdf, si, active)
        cosine = dr.maximum(wo.z * side, 0)
        pdf = dr.select(dr.any(reflectance > 0), cosine * dr.inv_pi, 0)
        bs, weight = self._sampled(reflectance, side, u)
        if self.are_all:
            return depolarised(reflectance * pdf), pdf, bs, weight
        value_other, pdf_other, other, weight_other = bsdf.eval_pdf_sample(ctx, si, wo, u_lobe, u, active & ~is_plain)
        return (
            dr.select(is_plain, depolarised(reflectance * pdf), value_other),
            dr.select(is_plain, pdf, pdf_other),
            dr.select(is_plain, bs, other),
            dr.select(is_plain, weight, weight_other),
        )

    def sample(self, bsdf: Any, ctx: Any, si: Any, u_lobe: Any, u: Any, active: Any) -> tuple[Any, Any]:
        """As Mitsuba's BSDF of that name, for all surfaces."""
        if self.is_empty:
            return bsdf.sample(ctx, si, u_lobe, u, active)
        reflectance, side, is_plain = self._reflectance(bsdf, si, active)
        bs, weight = self._sampled(reflectance, side, u)
        if self.are_all:
            return bs, weight
        other, weight_other = bsdf.sample(ctx, si, u_lobe, u, active & ~is_plain)
        return dr.select(is_plain, bs, other), dr.select(is_plain, weight, weight_other)

    def eval_pdf(self, bsdf: Any, ctx: Any, si: Any, wo: Any, active: Any) -> tuple[Any, Any]:
        """As Mitsuba's BSDF of that name, for all surfaces."""
        if self.is_empty:
            return bsdf.eval_pdf(ctx, si, wo, active)
        reflectance, side, is_plain = self._reflectance(bsdf, si, active)
        pdf = dr.select(dr.any(reflectance > 0), dr.maximum(wo.z * side, 0) * dr.inv_pi, 0)
        if self.are_all:
            return reflectance * pdf, pdf
        value_other, pdf_other = bsdf.eval_pdf(ctx, si, wo, active & ~is_plain)
        return dr.select(is_plain, reflectance * pdf, value_other), dr.select(is_plain, pdf, pdf_other)

    def _reflectance(self, bsdf: Any, si: Any, active: Any) -> tuple[Any, Any, Any]:
        """Reflectance of the side that is seen, the sign of its normal, and whether the surface is plain."""
        cosine = mi.Frame3f.cos_theta(si.wi)
        side = dr.select(cosine < 0, mi.Float(-1), 1)
        found_id: Any = dr.reinterpret_array(mi.UInt32, bsdf)
        at = dr.minimum(found_id, mi.UInt32(self.beyond))
        found = dr.gather(mi.Vector4f, self._rows, 2 * at + dr.select(cosine < 0, mi.UInt32(1), 0), active)
        reflectance = mi.Color3f(found.x, found.y, found.z)
        return mi.UnpolarizedSpectrum(found.x) if mi.is_monochromatic else reflectance, side, found.w > 0

    def _sampled(self, reflectance: Any, side: Any, u: Any) -> tuple[Any, Any]:
        bs = dr.zeros(mi.BSDFSample3f)
        bs.wo = mi.warp.square_to_cosine_hemisphere(u)
        bs.pdf = mi.warp.square_to_cosine_hemisphere_pdf(bs.wo)
        bs.wo.z *= side
        bs.eta = 1
        bs.sampled_type = mi.UInt32(+mi.BSDFFlags.DiffuseReflection)
        return bs, depolarised(dr.select(bs.pdf > 0, reflectance, 0))


def _may_be_plain(bsdf: Any) -> bool:
    flags = int(bsdf.flags())
    varies = mi.BSDFFlags.SpatiallyVarying | mi.BSDFFlags.Anisotropic | mi.BSDFFlags.All
    return bsdf.class_name() in ("SmoothDiffuse", "TwoSided") and not flags & int(varies) & ~int(
        mi.BSDFFlags.DiffuseReflection
    )


def _reflectances(bsdfs: list[Any]) -> dict[int, tuple[Any, Any] | None]:
    """By registry id, the reflectances of both sides; None where the answers are not those of Lambert's law."""
    if not bsdfs:
        return {}
    ids = np.array([registry_id(bsdf) for bsdf in bsdfs], np.uint32)
    rng = np.random.default_rng(1)
    n = len(ids) * 2 * PROBES
    # The same ones for all, or the last bits of what is found would depend on the order in which Mitsuba loads them.
    each = rng.uniform(0.1, 0.95, (2, 2 * PROBES)) * np.repeat([1, -1], PROBES)
    z, phi, uv = (
        np.tile(values, len(ids)) for values in (each, rng.uniform(0, 2 * np.pi, each.shape), rng.random(each.shape))
    )
    wi, wo = (mi.Vector3f(*(table(x, mi.Float) for x in _directions(z[k], phi[k]))) for k in range(2))
    si = dr.zeros(mi.SurfaceInteraction3f, n)
    si.wi, si.sh_frame = wi, mi.Frame3f(mi.Normal3f(0, 0, 1))
    si.n = mi.Normal3f(0, 0, 1)
    si.uv = mi.Point2f(*(table(x, mi.Float) for x in uv))
    pointers: Any = dr.reinterpret_array(mi.BSDFPtr, table(np.repeat(ids, 2 * PROBES), mi.UInt32))
    value, pdf = pointers.eval_pdf(mi.BSDFContext(), si, wo, dr.full(mi.Bool, True, n))
    values = np.array(intensity(value), np.float64)
    channels = 1 if mi.is_monochromatic else 3
    answers = values.reshape(channels, len(ids), 2, PROBES) * np.pi / np.abs(z[1]).reshape(len(ids), 2, PROBES)
    pdfs = np.array(pdf, np.float64).reshape(len(ids), 2, PROBES) * np.pi / np.abs(z[1]).reshape(len(ids), 2, PROBES)
    found: dict[int, tuple[Any, Any] | None] = {}
    for i, registry in enumerate(ids):
        sides = answers[:, i].mean(axis=-1)  # (channels, 2)
        is_plain = np.abs(answers[:, i] - sides[..., None]).max() <= TOLERANCE
        expected = (sides > 0).any(axis=0)[:, None]
        is_plain &= bool(np.abs(pdfs[i] - expected).max() <= TOLERANCE)
        found[int(registry)] = (sides[:, 0], sides[:, 1]) if is_plain else None
    return found


def _directions(z: Any, phi: Any) -> tuple[Any, Any, Any]:
    across = np.sqrt(1 - z**2)
    return across * np.cos(phi), across * np.sin(phi), z
