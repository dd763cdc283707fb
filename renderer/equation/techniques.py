"""How the next direction is drawn at a vertex: by the BSDF, or by the cosine, or uniformly (the hemisphere form).

Enters: a surface interaction and random numbers. Leaves: a BSDF sample (direction, solid-angle pdf, lobe) and the
weight f·cosθ/pdf. Directions of delta lobes (mirrors, clear glass) can only come from the BSDF itself; where a BSDF has
both kinds of lobes, one of the two is chosen with probability 1/2.
"""

from __future__ import annotations

from typing import Any

import drjit as dr

from renderer.backend import mitsuba
from renderer.equation.matte import Matte

mi: Any = mitsuba()


class Directions:
    """Draws directions by one technique.

    splits_lobes: whether delta and smooth lobes are drawn apart where a BSDF has both. The hemisphere's techniques need
    it; Mitsuba's blends need it too, whose own sampling mixes a delta lobe's probability with the other's density.
    """

    def __init__(self, technique: str, splits_lobes: bool = False, matte: Matte | None = None) -> None:
        self.by_bsdf = technique not in ("uniform", "cosine")
        self.is_uniform = technique == "uniform"
        self.splits_lobes = splits_lobes or not self.by_bsdf
        self.matte = matte or Matte([])

    def sample(self, bsdf: Any, ctx: Any, si: Any, u_lobe: Any, u: Any, active: Any) -> tuple[Any, Any]:
        """Returns (BSDFSample3f, weight)."""
        if not self.splits_lobes:
            return self.matte.sample(bsdf, ctx, si, u_lobe, u, active)
        p_delta = delta_probability(bsdf)
        takes_delta = u_lobe < p_delta
        u_lobe = dr.select(takes_delta, u_lobe / p_delta, (u_lobe - p_delta) / (1 - p_delta))
        bs, weight = bsdf.sample(lobes("delta"), si, u_lobe, u, active & takes_delta)
        weight = weight / p_delta

        is_smooth = active & ~takes_delta
        if self.by_bsdf:
            smooth, smooth_weight = bsdf.sample(lobes("smooth"), si, u_lobe, u, is_smooth)
            for name in ("wo", "pdf", "eta", "sampled_type", "sampled_component"):
                setattr(bs, name, dr.select(is_smooth, getattr(smooth, name), getattr(bs, name)))
            bs.pdf[is_smooth] = bs.pdf * (1 - p_delta)
            weight[is_smooth] = smooth_weight / (1 - p_delta)
            return bs, weight
        wo, pdf = self.warp(si.wi, mi.has_flag(bsdf.flags(), mi.BSDFFlags.Transmission), u_lobe, u)
        value = bsdf.eval(ctx, si, wo, is_smooth)
        bs.wo[is_smooth] = wo
        bs.pdf[is_smooth] = pdf * (1 - p_delta)
        bs.eta[is_smooth] = 1
        bs.sampled_type[is_smooth] = mi.UInt32(+mi.BSDFFlags.Smooth)
        weight[is_smooth] = dr.select(pdf > 0, value / (pdf * (1 - p_delta)), 0)
        return bs, weight

    def eval_pdf(self, bsdf: Any, ctx: Any, si: Any, wo: Any, active: Any) -> tuple[Any, Any]:
        """f·cosθ of the direction wo, and the density with which `sample` draws it."""
        if not self.splits_lobes:
            return bsdf.eval_pdf(ctx, si, wo, active)
        value, pdf = bsdf.eval_pdf(lobes("smooth"), si, wo, active)
        return value, pdf * (1 - delta_probability(bsdf))

    def eval_pdf_sample(
        self, bsdf: Any, ctx: Any, si: Any, wo: Any, u_lobe: Any, u: Any, active: Any
    ) -> tuple[Any, ...]:
        """What `eval_pdf` says of wo, and what `sample` draws."""
        if not self.splits_lobes:
            return self.matte.eval_pdf_sample(bsdf, ctx, si, wo, u_lobe, u, active)
        return *self.eval_pdf(bsdf, ctx, si, wo, active), *self.sample(bsdf, ctx, si, u_lobe, u, active)

    def warp(self, wi: Any, has_transmission: Any, u_side: Any, u: Any) -> tuple[Any, Any]:
        """A local direction and its solid-angle pdf: over the hemisphere of wi, or all around if light passes."""
        if self.is_uniform:
            wo, pdf = mi.warp.square_to_uniform_hemisphere(u), mi.Float(dr.inv_two_pi)
        else:
            wo = mi.warp.square_to_cosine_hemisphere(u)
            pdf = mi.warp.square_to_cosine_hemisphere_pdf(wo)
        goes_through = has_transmission & (u_side < 0.5)
        side = dr.select((mi.Frame3f.cos_theta(wi) >= 0) != goes_through, 1, -1)
        wo.z *= side
        return wo, dr.select(has_transmission, 0.5 * pdf, pdf)


def lobes(kind: str) -> Any:
    """A BSDF context that admits only delta lobes (with null ones, which let light pass), or only smooth ones."""
    ctx = mi.BSDFContext()
    ctx.type_mask = mi.BSDFFlags.Delta | mi.BSDFFlags.Null if kind == "delta" else mi.BSDFFlags.Smooth
    return ctx


def delta_probability(bsdf: Any) -> Any:
    """Probability of drawing a delta lobe where lobes are drawn apart: 1/2 where a BSDF has both kinds."""
    flags = bsdf.flags()
    has_smooth = mi.has_flag(flags, mi.BSDFFlags.Smooth)
    has_delta = mi.has_flag(flags, mi.BSDFFlags.Delta) | mi.has_flag(flags, mi.BSDFFlags.Null)
    return dr.select(has_delta, dr.select(has_smooth, 0.5, 1.0), 0.0)
