"""Random numbers of a replicate: padded (0,2)-sequences, Owen-scrambled by hashing.

Enters: a key (seed, pixel, replicate), a dimension and the sample's index in its replicate. Leaves: points in [0,1)².
Every dimension pair is its own (0,2)-sequence with its own scrambling and its own shuffled order, so that pairs are
independent of each other while the samples of a replicate stratify each pair. Nothing is stored.

Sources: Kollig & Keller 2002 (padding); Laine & Karras 2011, improved constants by Vegdahl 2021 (hashed Owen
scrambling); Burley 2020 (shuffling the index).
"""

from __future__ import annotations

from typing import Any

import drjit as dr

# Types are those of the active Mitsuba variant (mi.UInt32, mi.Point2f, …), known only at run time.
type_ = Any

INDEX_BITS = 6  # replicates hold at most 64 samples
ONE_MINUS_EPSILON = 1 - 2**-24


def mix(x: type_) -> type_:
    """A bijective 32-bit finaliser with low bias (Wellons' `lowbias32`)."""
    x = x ^ (x >> 16)  # not `^=`, which would change the caller's array
    x *= 0x7FEB352D
    x ^= x >> 15
    x *= 0x846CA68B
    return x ^ (x >> 16)


def scramble_reversed(x: type_, seed: type_) -> type_:
    """Owen scrambling of a number whose bits are reversed: every bit flips by a hash of the bits below it."""
    x = x ^ (x * 0x3D20ADEA)  # not `^=`, which would change the caller's array
    x += seed
    x *= (seed >> 16) | 1
    x ^= x * 0x05526C56
    return x ^ (x * 0x53A22864)


def second_dimension_reversed(index: type_, bits: int) -> type_:
    """Second Sobol' coordinate of index as 32 bits, least significant first; only its lowest `bits` bits may be set."""
    result = type(index)(0)
    direction = 1
    for bit in range(bits):
        result ^= dr.select((index & (1 << bit)) != 0, type(index)(direction), 0)
        direction ^= direction << 1 & 0xFFFFFFFF
    return result


def unit(x: type_, float_type: type_) -> type_:
    """A 32-bit number as a float in [0, 1)."""
    return dr.minimum(float_type(x >> 8) * 2.0**-24, ONE_MINUS_EPSILON)


class Sequence:
    """Points of one replicate per lane.

    key_a, key_b: UInt32 per lane, identify (seed, pixel, replicate). replicate_size: a power of two up to 64, an int or
    an opaque UInt32, so that one kernel serves all sizes.
    """

    def __init__(self, mi: type_, key_a: type_, key_b: type_, replicate_size: type_, stratified: bool = True) -> None:
        self.mi = mi
        self.key_a = key_a
        self.key_b = key_b
        self.mask = replicate_size - 1
        self.stratified = stratified

    @staticmethod
    def keys(seed_low: type_, seed_high: type_, pixel: type_, replicate: type_) -> tuple[type_, type_]:
        """Two hashes of (seed, pixel, replicate); 64 bits together, so that lanes practically never collide."""
        a = mix(seed_low + 0x9E3779B9)
        a = mix(a ^ (seed_high * 0x85EBCA6B))
        a = mix(a + pixel * 0xC2B2AE35)
        a = mix(a ^ (replicate + 0x27D4EB2F))
        b = mix(seed_high + 0x165667B1)
        b = mix(b ^ (seed_low * 0x9E3779B1))
        b = mix(b + replicate * 0x85EBCA77)
        b = mix(b ^ (pixel + 0xC2B2AE3D))
        return a, b

    def point(self, index: type_, dimension: type_) -> type_:
        """The index-th point of the pair `dimension` as a Point2f in [0,1)²."""
        mi = self.mi
        h = mix(self.key_a ^ (mi.UInt32(dimension) * 0x9E3779B9))
        seed_order = mix(h + self.key_b)
        seed_x = mix(h ^ (self.key_b * 0x85EBCA6B))
        seed_y = mix(seed_x + 0x68BC21EB)
        if not self.stratified:  # independent uniform points: the plain alternative, for comparison
            salt = index * 0xC2B2AE35
            return mi.Point2f(unit(mix(seed_x ^ salt), mi.Float), unit(mix(seed_y ^ salt), mi.Float))
        # A scrambled index visits the same first points in another order.
        shuffled = dr.brev(scramble_reversed(dr.brev(mi.UInt32(index)), seed_order)) & self.mask
        x = scramble_reversed(shuffled, seed_x)  # the first coordinate is the index itself, reversed
        y = scramble_reversed(second_dimension_reversed(shuffled, INDEX_BITS), seed_y)
        return mi.Point2f(unit(dr.brev(x), mi.Float), unit(dr.brev(y), mi.Float))
