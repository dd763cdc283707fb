"""The API of one-dimensional integrals: the estimator itself, of functions that are typed in."""

from __future__ import annotations

import math

import httpx

SINE = {"f": "sin(x)", "a": 0, "b": math.pi}


def test_an_estimate_holds_the_integral_and_tells_its_points(client: httpx.Client) -> None:
    told = client.get("/api/integral", params=SINE | {"n": 1024, "shown": 20}, timeout=60).json()
    assert abs(told["value"] - 2) < 5 * told["standard_error"]
    assert told["low"] < told["value"] < told["high"]
    assert math.isclose(told["truth"], 2, rel_tol=1e-6)
    assert math.isclose(told["standard_error"], math.sqrt(told["variance"] / 1024))
    assert len(told["points"]["x"]) == 20
    best = client.get("/api/integral", params=SINE | {"n": 64, "density": "best"}, timeout=60).json()
    assert best["variance"] < 1e-20
    alone = client.get("/api/integral", params=SINE | {"n": 1}, timeout=60).json()
    assert alone["variance"] is None
    assert alone["low"] is None


def test_runs_scatter_as_one_over_root_n(client: httpx.Client) -> None:
    told = client.get("/api/integral/runs", params=SINE | {"n": 64, "runs": 50}, timeout=60).json()
    assert told["counts"] == [1, 4, 16, 64]
    assert len(told["values"]) == 50


def test_what_is_no_function_is_refused_with_the_word(client: httpx.Client) -> None:
    for f, word in (("open('x')", "not known"), ("1/0", "finite"), ("x +", "no expression")):
        answer = client.get("/api/integral", params={"f": f}, timeout=60)
        assert answer.status_code == 422
        assert word in answer.json()["detail"], answer.text
    assert client.get("/api/integral", params={"f": "x", "a": "nan"}, timeout=60).status_code == 422
    assert client.get("/api/integral", params={"f": "x" * 200}, timeout=60).status_code == 422
    other_site = client.get("/api/integral", params=SINE, headers={"Sec-Fetch-Site": "cross-site"})
    assert other_site.status_code == 403
