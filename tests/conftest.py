"""Points Dr.Jit at a libLLVM that works, before any test imports it by itself."""

from __future__ import annotations

import os

from renderer.backend import find_llvm

if llvm := find_llvm():
    os.environ.setdefault("DRJIT_LIBLLVM_PATH", llvm)
