"""How the next direction is drawn at a vertex: by the BSDF, or by the cosine, or uniformly (the hemisphere form).

Enters: a surface interaction and random numbers. Leaves: a BSDF sample (direction, solid-angle pdf, lobe) and the
weight f·cosθ/pdf. Directions of delta lobes (mirrors, clear glass) can only come from the BSDF itself; where a BSDF has
both kinds of lobes, one of the two is chosen with probability 1/2.
"""

from __future__ import annotations

from typing import Any

import drjit as dr

from renderer.backend import mitsuba

mi: Any = mitsuba()


class Directions:
    """Draws directions by one technique."""

    def __init__(self, technique: str) -> None:
        self.by_bsdf = technique not in ("uniform", "cosine")
        self.is_uniform = technique == "uniform"

    def sample(self, bsdf: Any, ctx: Any, si: Any, u_lobe: Any, u: Any, active: Any) -> tuple[Any, Any]:
        """Returns (BSDFSample3f, weight)."""
        if self.by_bsdf:
            return bsdf.sample(ctx, si, u_lobe, u, active)
        flags = bsdf.flags()
        has_smooth = mi.has_flag(flags, mi.BSDFFlags.Smooth)
        has_delta = mi.has_flag(flags, mi.BSDFFlags.Delta) | mi.has_flag(flags, mi.BSDFFlags.Null)
        p_delta = dr.select(has_delta, dr.select(has_smooth, 0.5, 1.0), 0.0)
        takes_delta = u_lobe < p_delta
        u_lobe = dr.select(takes_delta, u_lobe / p_delta, (u_lobe - p_delta) / (1 - p_delta))

        delta_ctx = mi.BSDFContext()
        delta_ctx.type_mask = mi.BSDFFlags.Delta | mi.BSDFFlags.Null
        bs, weight = bsdf.sample(delta_ctx, si, u_lobe, u, active & takes_delta)
        weight = weight / p_delta

        wo, pdf = self.warp(si.wi, mi.has_flag(flags, mi.BSDFFlags.Transmission), u_lobe, u)
        is_smooth = active & ~takes_delta
        value = bsdf.eval(ctx, si, wo, is_smooth)
        bs.wo[is_smooth] = wo
        bs.pdf[is_smooth] = pdf * (1 - p_delta)
        bs.eta[is_smooth] = 1
        bs.sampled_type[is_smooth] = mi.UInt32(+mi.BSDFFlags.Smooth)
        weight[is_smooth] = dr.select(pdf > 0, value / (pdf * (1 - p_delta)), 0)
        return bs, weight

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
