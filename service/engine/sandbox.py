"""What a process gives up before it reads strangers' files: as much as the system takes from anyone, without new
rights.

Landlock (Linux 5.13) confines files, and later connections and signals; seccomp refuses calls; resource limits bound
the rest. None of them can be undone within the process, and threads inherit them: files are confined before the first
thread begins, calls once nothing more has to be started. Leaves, for the log: what the system could not do.
References: Linux user-space API guide, Landlock and Seccomp BPF.
"""

from __future__ import annotations

import contextlib
import ctypes
import glob
import os
import platform
import struct
import sys
import sysconfig
from collections.abc import Iterable
from pathlib import Path

_PR_SET_NO_NEW_PRIVS = 38
_O_PATH = getattr(os, "O_PATH", 0)

# ------------------------------ Landlock ------------------------------

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446  # on every architecture
_RULE_PATH_BENEATH, _ASK_VERSION = 1, 1
_EXECUTE, _WRITE_FILE, _READ_FILE, _READ_DIR, _TRUNCATE, _IOCTL = (1 << bit for bit in (0, 1, 2, 3, 14, 15))
_FILES_BY_VERSION = {1: (1 << 13) - 1, 2: (1 << 14) - 1, 3: (1 << 15) - 1, 4: (1 << 15) - 1, 5: (1 << 16) - 1}
_CONNECTIONS, _SCOPES = 0b11, 0b11  # TCP: bind, connect; abstract sockets and signals of others
_OF_FILES = _EXECUTE | _WRITE_FILE | _READ_FILE | _TRUNCATE | _IOCTL  # other rights are of folders

_SYSTEM = (
    "/usr /lib /lib64 /etc/ld.so.cache /etc/ld.so.conf /etc/ld.so.conf.d /etc/localtime /proc/self /proc/cpuinfo "
    "/proc/meminfo /proc/stat /sys/devices/system /sys/fs/cgroup /nix/store"
).split()
_DEVICES = ("/dev/null", "/dev/zero", "/dev/random", "/dev/urandom", *glob.glob("/dev/nvidia*"))


def programs() -> list[Path]:
    """Where the interpreter, its packages, this program and the libraries of the system lie."""
    import renderer
    import service

    own = [Path(str(module.__file__)).parent for module in (renderer, service)]
    python = [sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    prefixes = [Path(prefix) / "lib" for prefix in (sys.prefix, sys.base_prefix)]
    llvm = os.environ.get("DRJIT_LIBLLVM_PATH")
    return [*own, *map(Path, (*python, *_SYSTEM)), *prefixes, *([Path(llvm).resolve().parent] if llvm else [])]


def confine_files(readable: Iterable[Path], writable: Iterable[Path]) -> list[str]:
    """From now on this thread, and those that it begins, open nothing outside of these folders."""
    version = _landlock_version()
    if version < 1:
        return ["files of this user cannot be kept from the process (the system has no Landlock)"]
    handled = _FILES_BY_VERSION[min(version, max(_FILES_BY_VERSION))]
    attributes = struct.pack("QQQ", handled, _CONNECTIONS, _SCOPES)[: 8 if version < 4 else 16 if version < 6 else 24]
    ruleset = _syscall(_CREATE_RULESET, attributes, len(attributes), 0)
    if ruleset < 0:
        return [f"files of this user cannot be kept from the process ({os.strerror(ctypes.get_errno())})"]
    try:
        for path in readable:
            _allow(ruleset, path, handled & (_EXECUTE | _READ_FILE | _READ_DIR))
        for path in (*writable, *map(Path, _DEVICES)):
            _allow(ruleset, path, handled & ~_EXECUTE)
        _give_up_privileges()
        if _syscall(_RESTRICT_SELF, ruleset, 0) != 0:
            return [f"files of this user cannot be kept from the process ({os.strerror(ctypes.get_errno())})"]
    finally:
        os.close(ruleset)
    return []


def _allow(ruleset: int, path: Path, rights: int) -> None:
    """Allow what lies below a path; nothing where there is no such path."""
    with contextlib.suppress(OSError):
        handle = os.open(path, _O_PATH | os.O_CLOEXEC)
        try:
            rights &= ~0 if path.is_dir() else _OF_FILES
            _syscall(_ADD_RULE, ruleset, _RULE_PATH_BENEATH, struct.pack("=Qi", rights, handle), 0)
        finally:
            os.close(handle)


def _landlock_version() -> int:
    return _syscall(_CREATE_RULESET, None, 0, _ASK_VERSION) if sys.platform == "linux" else 0


# ------------------------------ Seccomp ------------------------------

_SECCOMP = {"x86_64": 317, "aarch64": 277}
_AUDIT_ARCH = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
_SET_FILTER, _ALL_THREADS = 1, 1
_ALLOW, _REFUSE = 0x7FFF0000, 0x00050000 | 1  # EPERM
_LOAD, _EQUAL, _AT_LEAST, _RETURN = 0x20, 0x15, 0x35, 0x06
_X32 = 0x40000000  # x86_64 has a second set of numbers from here on
_INTERNET = (2, 10, 17)  # families of sockets: IPv4, IPv6, packets

# What no reader or renderer of scenes does: look into or signal other processes, change the system, be traced.
_NEVER = {
    "x86_64": {
        "kill": 62, "ptrace": 101, "pivot_root": 155, "chroot": 161, "mount": 165, "umount2": 166, "init_module": 175,
        "delete_module": 176, "kexec_load": 246, "add_key": 248, "request_key": 249, "keyctl": 250, "unshare": 272,
        "perf_event_open": 298, "open_by_handle_at": 304, "setns": 308, "process_vm_readv": 310,
        "process_vm_writev": 311, "finit_module": 313, "kexec_file_load": 320, "bpf": 321, "userfaultfd": 323,
        "pidfd_send_signal": 424, "io_uring_setup": 425, "move_mount": 429, "fsopen": 430, "pidfd_getfd": 438,
    },
    "aarch64": {
        "kill": 129, "ptrace": 117, "pivot_root": 41, "chroot": 51, "mount": 40, "umount2": 39, "init_module": 105,
        "delete_module": 106, "kexec_load": 104, "add_key": 217, "request_key": 218, "keyctl": 219, "unshare": 97,
        "perf_event_open": 241, "open_by_handle_at": 265, "setns": 268, "process_vm_readv": 270,
        "process_vm_writev": 271, "finit_module": 273, "kexec_file_load": 294, "bpf": 280, "userfaultfd": 282,
        "pidfd_send_signal": 424, "io_uring_setup": 425, "move_mount": 429, "fsopen": 430, "pidfd_getfd": 438,
    },
}  # fmt: skip
_PROGRAMS = {
    "x86_64": {"execve": 59, "execveat": 322, "vfork": 58, "fork": 57},
    "aarch64": {"execve": 221, "execveat": 281},
}
_SOCKET = {"x86_64": 41, "aarch64": 198}


def confine_calls(*, may_start_programs: bool) -> list[str]:
    """From now on no thread of this process reaches the network or other processes; nor does it start programs.

    may_start_programs: it may, and open sockets of this machine, as drivers do.
    """
    machine = platform.machine()
    if sys.platform != "linux" or machine not in _SECCOMP:
        return [f"calls of the process are not filtered ({sys.platform} on {machine} is not known)"]
    numbers = list(_NEVER[machine].values())
    if not may_start_programs:
        numbers += [*_PROGRAMS[machine].values(), _SOCKET[machine]]
    program = _filter(machine, numbers, _SOCKET[machine])
    buffer = ctypes.create_string_buffer(program, len(program))
    described = struct.pack("HxxxxxxP", len(program) // 8, ctypes.addressof(buffer))
    _give_up_privileges()
    if _syscall(_SECCOMP[machine], _SET_FILTER, _ALL_THREADS, described) != 0:
        return [f"calls of the process are not filtered ({os.strerror(ctypes.get_errno())})"]
    return []


def _filter(machine: str, refused: list[int], socket: int) -> bytes:
    """A BPF program: calls of another architecture, those refused, and sockets of the internet end with EPERM."""

    def step(code: int, value: int, if_true: int = 0, if_false: int = 0) -> bytes:
        return struct.pack("HBBI", code, if_true, if_false, value)

    refuse = step(_RETURN, _REFUSE)
    parts = [step(_LOAD, 4), step(_EQUAL, _AUDIT_ARCH[machine], 1, 0), refuse, step(_LOAD, 0)]
    if machine == "x86_64":
        parts += [step(_AT_LEAST, _X32, 0, 1), refuse]
    for number in refused:
        parts += [step(_EQUAL, number, 0, 1), refuse]
    families = [part for family in _INTERNET for part in (step(_EQUAL, family, 0, 1), refuse)]
    parts += [step(_EQUAL, socket, 0, 1 + len(families)), step(_LOAD, 16), *families, step(_RETURN, _ALLOW)]
    return b"".join(parts)


# ------------------------------ The rest ------------------------------


def bound_resources(file_bytes: int, open_files: int) -> list[str]:
    """No memory dumps (they hold what was read), no large files, few open ones."""
    try:
        import resource
    except ImportError:
        return ["files and memory dumps of the process are not bounded"]
    for kind, limit in (
        (resource.RLIMIT_CORE, 0),
        (resource.RLIMIT_FSIZE, file_bytes),
        (resource.RLIMIT_NOFILE, open_files),
    ):
        _, hard = resource.getrlimit(kind)
        least = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
        resource.setrlimit(kind, (least, least))
    return []


def missing() -> list[str]:
    """What this system cannot do, known without giving anything up."""
    found: list[str] = []
    if _landlock_version() < 1:
        found.append("files of this user cannot be kept from the process (the system has no Landlock)")
    if sys.platform != "linux" or platform.machine() not in _SECCOMP:
        found.append("calls of the process are not filtered (this is no Linux on x86-64 or ARM)")
    return found


def has_graphics_driver() -> bool:
    """Whether a driver may need rights of its own."""
    return Path("/proc/driver/nvidia").exists() or Path("/dev/nvidiactl").exists() or Path("/dev/dxg").exists()


def _give_up_privileges() -> None:
    ctypes.CDLL(None).prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)


def _syscall(number: int, *arguments: object) -> int:
    libc = ctypes.CDLL(None, use_errno=True)
    libc.syscall.restype = ctypes.c_long
    passed = [ctypes.c_long(one) if isinstance(one, int) else one for one in arguments]
    return int(libc.syscall(ctypes.c_long(number), *passed))
