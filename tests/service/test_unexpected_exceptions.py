"""An exception inside a traced kernel may spoil the kernels that its process traces later: the process is replaced."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from service_process import ROOT, SMALL, Server, is_alive, wait_for

import renderer

BAD_SEED = 13
LONG = 12_800  # samples per pixel of a job that still renders when the other has failed for good
# Read by every Python of the service at its start: makes tracing a kernel with the bad seed raise in its loop.
_SABOTAGE = f"""
import importlib.abc, importlib.util, sys

class Sabotage(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name != "renderer.equation.path":
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        execute = spec.loader.exec_module
        def execute_and_sabotage(module):
            execute(module)
            begin, heuristic, seeds = module.PathKernel.begin, module.power_heuristic, []
            def noted(self, pixels, replicates, seed):
                seeds[:] = [seed]
                return begin(self, pixels, replicates, seed)
            def raising(*args):
                if seeds == [{BAD_SEED}]:
                    raise RuntimeError("/secret/path")
                return heuristic(*args)
            module.PathKernel.begin, module.power_heuristic = noted, raising
        spec.loader.exec_module = execute_and_sabotage
        return spec

sys.meta_path.insert(0, Sabotage())
"""


def test_after_an_unexpected_exception_the_process_is_replaced_and_only_that_job_fails(
    own_server: Server, tmp_path: Path
) -> None:
    site = tmp_path / "site"
    site.mkdir()
    (site / "sitecustomize.py").write_text(_SABOTAGE)
    own_server.environment |= {"PYTHONPATH": f"{site}:{ROOT}"}
    server = own_server.start()
    good = server.submit({"spp": LONG}, SMALL | {"seed": 5})["id"]
    server.wait(good, lambda job: job["frame_seq"] > 1)
    bad = server.wait_ended(server.submit({"spp": 16}, SMALL | {"seed": BAD_SEED})["id"])
    assert bad["state"] == "failed", bad
    assert bad["cause"]["title"] == "Rendering failed"
    assert "unexpected RuntimeError" in bad["cause"]["detail"]
    assert "tried 2 times" in bad["cause"]["detail"]
    assert "/" not in bad["cause"]["detail"]
    ended = server.wait_ended(good)
    assert ended["state"] == "succeeded", ended
    pids = server.render_pids()
    assert len(set(pids)) == 3, "one process before, one after each exception"
    wait_for(lambda: not any(is_alive(pid) for pid in pids[:-1]), 60, "the end of the replaced processes")
    # Who was running beside it lost nothing.
    mine = renderer.Estimate.read(next((server.data_dir / "estimates" / good).iterdir()))
    calm = renderer.render("cornell-box", renderer.Target(spp=LONG), renderer.Settings(64, 64, 5))
    assert np.array_equal(mine.moments.mean, calm.moments.mean)
    assert any("/secret/path" in line.get("trace", "") for line in server.log()), "the log says what it was"
