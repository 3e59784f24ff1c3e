"""Filters, listing and running of test binaries, shared by scripts/run_tests.py and scripts/breaks."""

import argparse
import os
import re
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# Longest running time first, which balances the load of the processors.
BINARIES = ["composite", "analyse", "window", "calibrate", "files", "live", "lib", "architecture"]
# Prefix of each package's unit-test paths, so that they match the folders of src/. The program's
# own tests start with their folder's name (`cli`) already.
PACKAGES = {"locard-engine": "", "locard-window": "window", "locard": ""}
# A test process without a result for this long hangs and is killed.
TIMEOUT_S = 600.0
# Interval at which a process without output is checked for its end.
POLL_S = 0.5

RESULT = re.compile(r"test (\S+)(?: - should panic)? \.\.\. (?:.*\b)?(ok|FAILED|ignored)\b")
BEGIN = re.compile(r"test (\S+)(?: - should panic)? \.\.\. ")
OUTPUT = re.compile(r"---- (\S+) stdout ----")
# A test that does nothing prints the first, one that runs in part the second.
SKIPPED, LEFT_OUT = "skipped: ", "left out: "


class Filter:
    """`BINARY` or `BINARY::PATH`."""

    def __init__(self, text):
        self.text = text
        self.binary, _, self.path = text.partition("::")
        if self.binary not in BINARIES:
            raise argparse.ArgumentTypeError(f"`{text}` names no test binary; there are {', '.join(BINARIES)}")

    def accepts(self, binary, test):
        at_boundary = test == self.path or test.startswith(f"{self.path}::")
        return binary == self.binary and (not self.path or at_boundary)

    def package(self):
        """The package of the unit tests, or None for all packages."""
        folder = self.path.partition("::")[0]
        if not folder:
            return None
        return {"window": "locard-window", "cli": "locard"}.get(folder, "locard-engine")


class CannotList(Exception):
    """A test binary does not start, or does not list its tests."""


class Binary:
    """A test binary. `module` is the prefix of its tests' paths, `package` the crate of unit tests."""

    def __init__(self, name, file, module="", package=""):
        self.name, self.file, self.module, self.package = name, file, module, package

    @classmethod
    def of_message(cls, message):
        """The test binary of a message of cargo's, or None."""
        if message.get("reason") != "compiler-artifact" or not message.get("executable"):
            return None
        target = message["target"]
        if not message["profile"]["test"] or target["kind"][0] not in ("lib", "test"):
            return None
        if target["kind"] == ["lib"]:
            package = target["name"].replace("_", "-")
            return cls("lib", message["executable"], PACKAGES[package], package)
        return cls(target["name"], message["executable"])

    def tests(self, full, folder=ROOT):
        """Paths of the tests that run in the tier."""

        def listed(*more):
            command = [self.file, "--list", "--format", "terse", *more]
            try:
                output = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, text=True, check=True)
            except (OSError, subprocess.CalledProcessError) as error:
                raise CannotList(f"{self.name}: {error}") from error
            return [line.removesuffix(": test") for line in output.stdout.splitlines() if line.endswith(": test")]

        ignored = set() if full else set(listed("--ignored"))
        return [self.qualified(test) for test in listed() if test not in ignored]

    def qualified(self, test):
        return f"{self.module}::{test}" if self.module else test

    def own_name(self, test):
        return test.removeprefix(f"{self.module}::") if self.module else test


def expected(filters=()):
    """The binaries that a build must yield, with the packages of unit tests: all, or those of filters."""
    all_of = {(name, "") for name in BINARIES if name != "lib"} | {("lib", package) for package in PACKAGES}
    if not filters:
        return all_of
    named = {f.binary for f in filters}
    packages = {f.package() for f in filters if f.binary == "lib"}
    return {(name, package) for name, package in all_of
            if name in named and (name != "lib" or None in packages or package in packages)}


# Folder in memory for the tests' temporary files, and the free bytes that they need.
MEMORY_FOLDER = "/dev/shm"
MIN_MEMORY_BYTES = 4 << 30


def in_memory(folder=MEMORY_FOLDER):
    """TMPDIR in memory: tests write thousands of small files and wait for the disk. Empty if TMPDIR is
    set, or if the folder is missing, too small, or forbids the programs that tests write."""
    if "TMPDIR" in os.environ:
        return {}
    try:
        state = os.statvfs(folder)
    except OSError:
        return {}
    is_usable = state.f_bavail * state.f_frsize >= MIN_MEMORY_BYTES and not state.f_flag & os.ST_NOEXEC
    return {"TMPDIR": folder} if is_usable and os.access(folder, os.W_OK) else {}


def environment(full, **more):
    """Environment of a test process."""
    # NODEVICE_SELECT as in .cargo/config.toml, which applies only to processes that cargo starts.
    # One thread per device of Mesa's software driver, because the other processors run test
    # processes of their own.
    tier = "full" if full else "fast"
    return {"LP_NUM_THREADS": "1", **in_memory(), **os.environ, "LOCARD_TEST_TIER": tier, "NODEVICE_SELECT": "1", **more}


# Running


class Result:
    """Outcome of a test: ok, FAILED, ignored or skipped. `note` is the reason for a skip."""

    def __init__(self, binary, test, wall_s, outcome, note=""):
        self.binary, self.test, self.wall_s, self.outcome, self.note = binary, test, wall_s, outcome, note


class Finished:
    """Results of a test process. `problem` is empty if it ended as its results say."""

    def __init__(self, results, missing, problem, log):
        self.results, self.missing, self.problem, self.log = results, missing, problem, log


_running, _lock = set(), threading.Lock()


def _kill(process):
    """Kills a process with all that it started."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        pass


def kill_tests_when_ended():
    """Lets the end of this program by a signal kill the test processes, which have groups of their own."""

    def end(number, _):
        for process in _running.copy():
            _kill(process)
        os._exit(128 + number)

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, end)


class _Lines:
    """Lines of a process's output, until it ends or prints nothing for a time."""

    def __init__(self, process, timeout_s):
        self.process, self.timeout_s = process, timeout_s
        self.rest, self.has_timed_out = b"", False
        self.restart()

    def restart(self):
        """Restarts the time limit."""
        self.deadline = time.monotonic() + self.timeout_s

    def __iter__(self):
        pipe = self.process.stdout.fileno()
        while True:
            has_ended = self.process.poll() is not None
            ready, _, _ = select.select([pipe], [], [], 0 if has_ended else POLL_S)
            block = os.read(pipe, 1 << 16) if ready else b""
            *lines, self.rest = (self.rest + block).split(b"\n")
            yield from (line.decode(errors="replace") for line in lines)
            # A process that outlives the test may hold the pipe open.
            if (ready and not block) or (has_ended and not ready):
                break
            if time.monotonic() > self.deadline:
                self.has_timed_out = True
                break
        if self.rest:
            yield self.rest.decode(errors="replace")


def run(binary, tests, full, environment, folder=ROOT, timeout_s=None, is_ended_by_failure=False):
    """Runs tests of a binary in one process, one after another. Returns a `Finished`.

    A process without a result for `timeout_s` is killed.
    """
    timeout_s = TIMEOUT_S if timeout_s is None else timeout_s
    command = [binary.file, "--exact", "--test-threads=1", "--show-output", *map(binary.own_name, tests)]
    if full:
        command.insert(1, "--include-ignored")
    last = time.monotonic()
    log, results, missing, begun = [], {}, list(tests), None
    with tempfile.TemporaryFile("w+", errors="replace") as errors:
        process = subprocess.Popen(
            command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=errors,
            start_new_session=True)
        with _lock:
            _running.add(process)
        lines = _Lines(process, timeout_s)
        for line in lines:
            log.append(f"{line}\n")
            begin, match = BEGIN.match(line), RESULT.match(line)
            begun = binary.qualified(begin[1]) if begin else begun
            # Output of a child process may part the result from the test's name.
            outcome = match[2] if match else line if line in ("ok", "FAILED") else None
            if outcome and begun in missing:
                now = time.monotonic()
                missing.remove(begun)
                results[begun] = Result(binary.name, begun, now - last, outcome)
                last = now
                lines.restart()
                if outcome == "FAILED" and is_ended_by_failure:
                    break
        if process.poll() is None and (lines.has_timed_out or is_ended_by_failure):
            _kill(process)
        status = process.wait()
        process.stdout.close()
        with _lock:
            _running.discard(process)
        errors.seek(0)
        printed = errors.read()
    _mark_skipped(binary, results, log)
    problem = ""
    has_failed = any(result.outcome == "FAILED" for result in results.values())
    if lines.has_timed_out:
        running = begun if begun in missing else "after the last test"
        problem = f"no result for {timeout_s:.0f} s, killed; running: {running}"
    elif missing and not (has_failed and is_ended_by_failure):
        running = begun if begun in missing else "none"
        problem = f"ended with status {status} before the last result; running: {running}"
    elif status != 0 and not has_failed:
        problem = f"ended with status {status} although no test failed"
    text = "".join(_without_successes(log)) + printed
    return Finished(list(results.values()), missing, problem, text)


def _mark_skipped(binary, results, log):
    """Sets the outcome of tests whose output tells that they were skipped, in whole or in part."""
    result = None
    for line in log:
        if header := OUTPUT.match(line):
            result = results.get(binary.qualified(header[1]))
        elif result and result.outcome == "ok" and line.startswith((SKIPPED, LEFT_OUT)):
            result.note = line.strip()
            if line.startswith(SKIPPED):
                result.outcome = "skipped"


def _without_successes(log):
    """A test process's output without that of the tests that passed."""
    is_kept = True
    for line in log:
        if line in ("successes:\n", "failures:\n") or line.startswith("test result:"):
            is_kept = line != "successes:\n"
        if is_kept:
            yield line


# Source


def source_of(binary, path):
    """File and line number, from 0, of a test or module; None if it is not found."""
    if binary == "lib":
        folder, file = ROOT / "src", ROOT / "src/engine.rs"
    elif binary == "architecture":
        folder, file = ROOT / "tests/architecture", ROOT / "tests/architecture.rs"
    else:
        folder, file = ROOT / "tests" / binary, ROOT / "tests" / binary / "main.rs"
    segments = path.split("::") if path else []
    while segments:
        name = segments[0]
        inner = [folder / f"{name}.rs", folder / name / "mod.rs", folder / name / "lib.rs"]
        module = next((candidate for candidate in inner if candidate.is_file()), None)
        # Only a folder on the way of `cli`, whose own file is the crate's.
        if module is None and not (folder / name).is_dir():
            break
        folder, file = folder / name, module or file
        segments.pop(0)
    lines = file.read_text().splitlines()
    at = 0
    for is_last, name in ((n == len(segments) - 1, name) for n, name in enumerate(segments)):
        kinds = "fn|mod" if is_last else "mod"
        of = re.compile(rf"\s*(?:pub(?:\(\w+\))? )?(?:{kinds}) {re.escape(name)}\b")
        at = next((n for n in range(at, len(lines)) if of.match(lines[n])), None)
        if at is None:
            return None
    return file, at


def reason_for_slow(binary, test):
    """The text of the line `// Slow: ...` above a test, or an empty string."""
    place = source_of(binary, test)
    if place is None:
        return ""
    lines = place[0].read_text().splitlines()
    for line in reversed(lines[:place[1]]):
        line = line.strip()
        if line.startswith("// Slow: "):
            return line.removeprefix("// Slow: ")
        # Comments and attributes belong to the test; other code ends them.
        if not line or line.endswith((";", "{", "}")):
            break
    return ""


def fail(program, text):
    """Ends the program with exit code 2."""
    print(f"{program}: {text}", file=sys.stderr)
    sys.exit(2)
