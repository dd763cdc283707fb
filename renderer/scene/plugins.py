"""What is known of each plugin of Mitsuba 3.9 that a scene may use: one row a plugin, and everyone reads them here.

A type is the name of a shared library, which Mitsuba looks for in the scene's folder first: a name without a row never
reaches it. To let scenes use another plugin, add its row. Its traits say what the kernel has to contain (`features`),
how it changes with the unit of length (`rewrite.similarity`), whether it has colour (`colour`), what file it names
(`assets`) and which technique finds it (`equation.reach`); one that is left out is never one that makes a kernel lack
something, unless its comment below says so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType

TRAITS: Mapping[str, str] = MappingProxyType(
    {
        # BSDFs. Without `smooth`, `delta` or `wraps` a BSDF would have no lobes at all.
        "smooth": "has lobes other than those of mirrors and clear glass",
        "delta": "has lobes of mirrors or clear glass; of an emitter: no ray can hit it, or only from one direction",
        "null": "may let light pass as if it were not there",
        "transmits": "light may pass it",
        "wraps": "has the lobes of what it wraps",
        "isotropic": "the same wherever on the surface and whichever way it is turned, as long as its parameters are",
        "metal": "its `material` names a file of Mitsuba's own",
        "polarises": "asks for light's polarisation",
        # Colour. Whatever has values of its own is looked at; these are coloured whatever those are.
        "coloured": "depends on wavelength",
        "spectral": "can be asked for single wavelengths only, not for red, green and blue",
        "geometry": "its texture is no colour",
        "even": "of a texture: the same everywhere",
        # Emitters.
        "environment": "what a ray sees that leaves the scene",
        "unseen": "no ray can see it",
        "far": "at infinity",
        "lengthless": "what it emits does not depend on the unit of length",
        # Shapes.
        "area": "Mitsuba draws points on its surface",
        "grows": "all its lengths grow with its transform",
        # Sensors and integrators.
        "meter": "its film is no picture in space",
        "radiance": "estimates radiance, as ours does",
        "volume": "of an integrator: renders participating media",
        # What `filename` names.
        "mesh": "a file of faces",
        "picture": "a file of pixels",
        "grid": "a file of voxels",
        "curves": "a file of control points",
        "splats": "a file of ellipsoids",
        "tensor": "a file of measurements",
    }
)


@dataclass(frozen=True, slots=True)
class Plugin:
    """A row. kind: Mitsuba's name for what such a node is. loaded: its class once loaded, where that is asked for.
    label: what to call it in a sentence. points: that a curve needs at least.
    """

    name: str
    kind: str
    traits: frozenset[str]
    loaded: str = ""
    label: str = ""
    points: int = 0


def _rows(kind: str, **traits: str) -> dict[str, Plugin]:
    return {name: Plugin(name, kind, frozenset(words.split())) for name, words in traits.items()}


def _emitter(name: str, loaded: str, label: str, traits: str) -> dict[str, Plugin]:
    return {name: Plugin(name, "Emitter", frozenset(traits.split()), loaded, label)}


def _shape(name: str, traits: str, loaded: str = "", points: int = 0) -> dict[str, Plugin]:
    return {name: Plugin(name, "Shape", frozenset(traits.split()), loaded, points=points)}


PLUGINS: Mapping[str, Plugin] = MappingProxyType(
    # ------------------------------ Shapes ------------------------------
    _shape("bsplinecurve", "curves", "BSplineCurve", points=4)
    | _shape("cube", "area grows")
    | _shape("cylinder", "area grows")
    | _shape("disk", "area grows")
    | _shape("ellipsoids", "splats", "Ellipsoids")
    | _shape("ellipsoidsmesh", "splats", "EllipsoidsMesh")
    | _shape("instance", "grows", "Instance")
    | _shape("linearcurve", "curves", "LinearCurve", points=2)
    | _shape("obj", "area grows mesh")
    | _shape("ply", "area grows mesh")
    | _shape("rectangle", "area grows")
    | _shape("sdfgrid", "grows grid", "SDFGrid")
    | _shape("serialized", "area grows mesh")
    | _shape("shapegroup", "")
    | _shape("sphere", "area grows")
    # ------------------------------ Emitters ------------------------------
    | _emitter("area", "AreaLight", "area light", "lengthless")
    | _emitter("constant", "ConstantBackgroundEmitter", "constant sky", "environment far lengthless")
    | _emitter("directional", "DirectionalEmitter", "directional light", "delta unseen far lengthless")
    | _emitter("directionalarea", "DirectionalArea", "directional area light", "delta lengthless")
    | _emitter("envmap", "EnvironmentMapEmitter", "environment map", "environment far lengthless picture")
    | _emitter("point", "PointLight", "point light", "delta unseen")
    | _emitter("projector", "Projector", "projector", "delta unseen")
    | _emitter("spot", "SpotLight", "spot light", "delta unseen")
    | _emitter("sunsky", "SunskyEmitter", "sun and sky", "environment far lengthless coloured")
    | _emitter("timed_sunsky", "TimedSunskyEmitter", "sun and sky", "environment far lengthless coloured")
    # ------------------------------ BSDFs: the flags of Mitsuba's documentation ------------------------------
    | _rows(
        "BSDF",
        blendbsdf="wraps isotropic",
        bumpmap="wraps geometry",
        circular="delta null transmits isotropic polarises",
        conductor="delta isotropic metal",
        dielectric="delta transmits isotropic",
        diffuse="smooth isotropic",
        hair="smooth transmits coloured",
        mask="wraps delta null transmits isotropic",
        measured="smooth coloured tensor",
        measured_polarized="smooth transmits coloured tensor polarises",
        normalmap="wraps geometry",
        null="delta null transmits isotropic",
        plastic="delta smooth isotropic",
        polarizer="delta null transmits isotropic polarises",
        pplastic="smooth",
        principled="smooth transmits",
        principledthin="smooth transmits",
        retarder="delta null transmits isotropic polarises",
        roughconductor="smooth isotropic metal",
        roughdielectric="smooth transmits isotropic",
        roughplastic="smooth isotropic",
        thindielectric="delta null transmits isotropic",
        twosided="wraps isotropic",
    )
    # ------------------------------ Textures ------------------------------
    | _rows(
        "Texture",
        bitmap="picture",
        blackbody="even coloured spectral",
        checkerboard="",
        d65="even",
        irregular="even coloured spectral",
        mesh_attribute="coloured",
        rawconstant="even coloured",
        regular="even coloured spectral",
        srgb="even",
        uniform="even",
        volume="",
    )
    # ------------------------------ Media ------------------------------
    | _rows("Medium", homogeneous="", heterogeneous="")
    | _rows("PhaseFunction", blendphase="", hg="", isotropic="", rayleigh="", sggx="", tabphase="")
    | _rows("Volume", constvolume="", gridvolume="grid")
    # ------------------------------ Sensors ------------------------------
    | _rows(
        "Sensor",
        batch="",
        distant="meter",
        irradiancemeter="meter",
        orthographic="",
        perspective="",
        radiancemeter="meter",
        thinlens="",
    )
    | _rows("Film", hdrfilm="", specfilm="coloured")
    | _rows("ReconstructionFilter", box="", catmullrom="", gaussian="", lanczos="", mitchell="", tent="")
    # ------------------------------ Replaced by ours, or never loaded ------------------------------
    | _rows("Sampler", independent="", ldsampler="", multijitter="", orthogonal="", stratified="")
    | _rows(
        "Integrator",
        aov="",
        depth="",
        direct="radiance",
        direct_projective="radiance",
        moment="",
        path="radiance",
        prb="radiance",
        prb_basic="radiance",
        prb_projective="radiance",
        prbvolpath="radiance volume",
        ptracer="radiance",
        stokes="radiance polarises",
        volpath="radiance volume",
        volpathmis="radiance volume",
        volprim_rf_basic="",
    )
)


@cache
def of_kind(kind: str) -> frozenset[str]:
    """Names of the plugins of a kind."""
    return frozenset(name for name, row in PLUGINS.items() if row.kind == kind)


@cache
def having(trait: str, kind: str | None = None) -> frozenset[str]:
    """Names of the plugins with a trait, of one kind or of all."""
    if trait not in TRAITS:
        raise KeyError(trait)
    return frozenset(n for n, row in PLUGINS.items() if trait in row.traits and kind in (None, row.kind))


@cache
def by_class() -> Mapping[str, Plugin]:
    """Rows by the name of the loaded class, of those where it is known."""
    return MappingProxyType({row.loaded: row for row in PLUGINS.values() if row.loaded})
