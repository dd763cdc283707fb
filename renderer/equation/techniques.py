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


class GuidedDirections:
    """Draws directions from a mixture of a guide and of what `Directions` draw (one-sample MIS, Veach 1997).

    A guide serves surfaces that scatter diffusely and let no light pass: it knows nothing of narrow lobes, and all that
    are mirrors or clear as well keep the share that their BSDF gives to either.
    """

    def __init__(self, inner: Directions, guide: Any) -> None:
        self.inner, self.guide = inner, guide
        self.by_bsdf, self.is_uniform, self.splits_lobes = inner.by_bsdf, inner.is_uniform, inner.splits_lobes
        self._eval_pdf = inner.eval_pdf if inner.splits_lobes else inner.matte.eval_pdf

    def sample(self, bsdf: Any, ctx: Any, si: Any, u_lobe: Any, u: Any, active: Any) -> tuple[Any, Any]:
        """As `Directions.sample`."""
        return self._sample(bsdf, ctx, si, None, u_lobe, u, active)[2:]

    def eval_pdf(self, bsdf: Any, ctx: Any, si: Any, wo: Any, active: Any) -> tuple[Any, Any]:
        """As `Directions.eval_pdf`."""
        value, pdf = self.inner.eval_pdf(bsdf, ctx, si, wo, active)
        is_served, place, share = self._place(bsdf, si, active)
        return value, self._mixed(share, pdf, place, si, wo, is_served)

    def eval_pdf_sample(
        self, bsdf: Any, ctx: Any, si: Any, wo: Any, u_lobe: Any, u: Any, active: Any
    ) -> tuple[Any, ...]:
        """As `Directions.eval_pdf_sample`. A sample's `eta` holds besides, where the guide serves, the root of how many
        times denser the mixture is than the BSDF's own directions: with its square, roulette takes a path for what it
        would carry without the guide. Else it would end those that were sent where light is, for they carry little.
        """
        return self._sample(bsdf, ctx, si, wo, u_lobe, u, active)

    def _sample(self, bsdf: Any, ctx: Any, si: Any, wo: Any, u_lobe: Any, u: Any, active: Any) -> tuple[Any, ...]:
        """As `eval_pdf_sample`; wo: None where nobody asks of another direction. Drawn from the guide, the cell comes
        from what is left of u_lobe, so that the cells of a replicate's samples are stratified, and u places it there.
        """
        is_served, place, share = self._place(bsdf, si, active)
        takes_guide = u_lobe >= share
        u_lobe = dr.minimum(dr.select(takes_guide, (u_lobe - share) / (1 - share), u_lobe / share), 1 - 2**-24)
        if wo is None:
            value, pdf = mi.Spectrum(0), mi.Float(0)
            bs, weight = self.inner.sample(bsdf, ctx, si, u_lobe, u, active)
        else:
            value, pdf, bs, weight = self.inner.eval_pdf_sample(bsdf, ctx, si, wo, u_lobe, u, active)
            pdf = self._mixed(share, pdf, place, si, wo, is_served)
        guided_wo = si.to_local(self.guide.sample(place, u_lobe, u, takes_guide))
        guided_value, guided_pdf = self._eval_pdf(bsdf, ctx, si, guided_wo, takes_guide)
        bs.wo[takes_guide] = guided_wo
        blind = dr.select(takes_guide, guided_pdf, bs.pdf)
        mixed = self._mixed(share, blind, place, si, bs.wo, is_served)
        weight[is_served] = dr.select(takes_guide, guided_value, weight * bs.pdf) / mixed
        weight[is_served & ~((mixed > 0) & (blind > 0))] = 0
        bs.pdf[is_served] = mixed
        bs.eta[is_served] = dr.select(blind > 0, dr.sqrt(mixed / blind), 1)
        bs.sampled_type[takes_guide] = mi.UInt32(+mi.BSDFFlags.DiffuseReflection)
        return value, pdf, bs, weight

    def _place(self, bsdf: Any, si: Any, active: Any) -> tuple[Any, Any, Any]:
        """Whether the guide serves a surface, the place there, and the share of directions that the BSDF draws."""
        is_served = active & is_served_by_guide(bsdf)
        place = self.guide.place(si.p, dr.select(si.wi.z < 0, -si.sh_frame.n, si.sh_frame.n), is_served)
        return is_served, place, dr.select(is_served, self.guide.share(place, is_served), 1)

    def _mixed(self, share: Any, pdf: Any, place: Any, si: Any, wo: Any, is_served: Any) -> Any:
        """Density of the mixture. pdf: that of the BSDF."""
        return share * pdf + (1 - share) * self.guide.pdf(place, si.to_world(wo), is_served)


def is_served_by_guide(bsdf: Any) -> Any:
    """Whether a guide draws some of a surface's directions."""
    kinds = mi.BSDFFlags
    flags = bsdf.flags()
    return mi.has_flag(flags, kinds.Diffuse) & ((flags & int(kinds.Transmission | kinds.Delta | kinds.Null)) == 0)
