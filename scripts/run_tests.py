#!/usr/bin/env python3
"""Builds and runs the tests and reports the time of each step. Called by `scripts/test`.

    scripts/test                       format, lint and all tests of the fast tier
    scripts/test composite             one test binary
    scripts/test composite::laws       the tests of one module; lib::effects::noise are unit tests of src/effects/noise,
                                       lib::window::history those of src/window/history.rs
    scripts/test --full [FILTER ...]   the full tier, or parts of it

A filter is `BINARY` or `BINARY::PATH`, with the binaries `lib`, `architecture` and the folders of tests/. With a filter
only the binaries that it names are built; format and documentation are not checked, and clippy's warnings are no
failure. In the fast tier such a build is incremental and at opt-level 1, which shortens the loop of edit and test.

Clippy runs as the compiler of the workspace's crates (RUSTC_WORKSPACE_WRAPPER, scripts/lint_once). This saves the
second pass over all dependencies that `cargo clippy` needs.

Test processes run side by side with one test thread each: a test that draws locks its process's only device, so
further threads would wait for it. Each module of a binary runs in a process of its own, whose tests share cached data.

Exit: 0 all passed, 1 a test or check failed, 2 wrong usage, no matching test, or the build failed.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# Longest running time first, which balances the load of the processors.
BINARIES = ["composite", "analyse", "window", "calibrate", "files", "live", "lib", "architecture"]
# A test of the fast tier above this time needs a line `// Slow: REASON` above it.
SLOW_S = 5.0
# Number of slowest tests that are listed.
SLOWEST_COUNT = 10
RESULT = re.compile(r"test (\S+)( - should panic)? \.\.\. (ok|FAILED|ignored)")


class Step:
    """A row of the table of times."""

    def __init__(self, name, wall_s, note=""):
        self.name, self.wall_s, self.note = name, wall_s, note


class Result:
    def __init__(self, binary, test, wall_s, outcome):
        self.binary, self.test, self.wall_s, self.outcome = binary, test, wall_s, outcome


class Filter:
    """`BINARY` or `BINARY::PATH`."""

    def __init__(self, text):
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


# Prefix of each package's unit-test paths, so that they match the folders of src/. The program's
# own tests start with their folder's name (`cli`) already.
PACKAGES = {"locard-engine": "", "locard-window": "window", "locard": ""}
# Profile of a build with filters: in many small codegen units an edit invalidates few.
LOOP_PROFILE = ["opt-level=1", "codegen-units=256"]


def cargo_environment(is_loop=False):
    # Incremental data slows a full build down and helps only the next one.
    return {**os.environ, "RUSTC_WORKSPACE_WRAPPER": str(ROOT / "scripts/lint_once"), "CARGO_INCREMENTAL": "1" if is_loop else "0"}


def cargo(*arguments):
    return subprocess.run(["cargo", *arguments], cwd=ROOT, env=cargo_environment())


class Binary:
    """A test binary. `module` is the prefix of its tests' paths."""

    def __init__(self, name, file, module=""):
        self.name, self.file, self.module = name, file, module

    def tests(self, full):
        """Paths of the tests that run in the tier."""

        def listed(*more):
            output = subprocess.run(
                [self.file, "--list", "--format", "terse", *more], cwd=ROOT, stdout=subprocess.PIPE, text=True)
            return [line.removesuffix(": test") for line in output.stdout.splitlines() if line.endswith(": test")]

        ignored = set(listed("--ignored"))
        return [self.qualified(test) for test in listed() if full or test not in ignored]

    def qualified(self, test):
        return f"{self.module}::{test}" if self.module else test

    def own_name(self, test):
        return test.removeprefix(f"{self.module}::") if self.module else test


def build(filters, is_loop):
    """Builds the test binaries. Returns them, or None if the build failed, and the number of warnings."""
    if not filters:
        targets = ["--workspace", "--all-targets"]
    else:
        names = sorted({f.binary for f in filters})
        targets = [word for name in names for word in (["--lib"] if name == "lib" else ["--test", name])]
        packages = {f.package() if f.binary == "lib" else "locard" for f in filters}
        chosen = ["--workspace"] if None in packages else [f"--package={package}" for package in sorted(packages)]
        targets += chosen
    if is_loop:
        settings = [f"profile.dev.package.{package}.{setting}" for package in PACKAGES for setting in LOOP_PROFILE]
        targets += [word for setting in settings for word in ("--config", setting)]
    command = ["cargo", "test", "--locked", "--no-run", "--message-format=json-diagnostic-rendered-ansi", *targets]
    process = subprocess.Popen(
        command, cwd=ROOT, env=cargo_environment(is_loop), stdout=subprocess.PIPE, text=True)
    binaries, warnings = [], 0
    for line in process.stdout:
        message = json.loads(line)
        if message.get("reason") == "compiler-message":
            print(message["message"]["rendered"], file=sys.stderr)
            warnings += message["message"]["level"] == "warning"
        if message.get("reason") != "compiler-artifact" or not message.get("executable"):
            continue
        target = message["target"]
        if not message["profile"]["test"] or target["kind"][0] not in ("lib", "test"):
            continue
        if target["kind"] == ["lib"]:
            module = PACKAGES[target["name"].replace("_", "-")]
            binaries.append(Binary("lib", message["executable"], module))
        else:
            binaries.append(Binary(target["name"], message["executable"]))
    binaries.sort(key=lambda binary: BINARIES.index(binary.name))
    return binaries if process.wait() == 0 else None, warnings


def grouped(binary, tests):
    """Groups tests by the first module of their path; each group runs in one process."""
    groups = defaultdict(list)
    for test in tests:
        groups[test.split("::")[0]].append(test)
    return [(binary, name, group) for name, group in groups.items()]


class Runner:
    """Runs groups of tests in processes side by side."""

    def __init__(self, groups, full):
        self.groups, self.full = groups, full
        # NODEVICE_SELECT as in .cargo/config.toml, which applies only to processes that cargo
        # starts. One thread per device of Mesa's software driver, because the other processors run
        # test processes of their own.
        overrides = {"LOCARD_TEST_TIER": "full" if full else "fast", "NODEVICE_SELECT": "1"}
        self.environment = {"LP_NUM_THREADS": "1", **os.environ, **overrides}
        self.lock = threading.Lock()
        self.results, self.failures = [], []

    def run(self, lanes):
        threads = [threading.Thread(target=self.work) for _ in range(lanes)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    def work(self):
        while True:
            with self.lock:
                if not self.groups:
                    return
                binary, name, tests = self.groups.pop(0)
            self.run_group(binary, name, tests)

    def run_group(self, binary, name, tests):
        command = [binary.file, "--exact", "--test-threads=1", *map(binary.own_name, tests)]
        if self.full:
            command.insert(1, "--include-ignored")
        start = last = time.monotonic()
        log, missing = [], set(tests)
        with tempfile.TemporaryFile("w+", errors="replace") as errors:
            process = subprocess.Popen(
                command, cwd=ROOT, env=self.environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                stderr=errors, text=True, errors="replace")
            for line in process.stdout:
                log.append(line)
                match = RESULT.match(line)
                test = binary.qualified(match[1]) if match else None
                if test in missing:
                    now = time.monotonic()
                    missing.remove(test)
                    with self.lock:
                        self.results.append(Result(binary.name, test, now - last, match[3]))
                    last = now
            status = process.wait()
            errors.seek(0)
            log.append(errors.read())
        with self.lock:
            # Tests without a result failed: their process ended early.
            self.results += [Result(binary.name, test, 0.0, "FAILED") for test in sorted(missing)]
            if status != 0 or missing:
                self.failures.append("".join(log))
            mark = "ok    " if status == 0 and not missing else "FAILED"
            print(f"{mark} {time.monotonic() - start:6.1f} s  {binary.name}::{name} ({len(tests)})", flush=True)


def reason_for_slow(binary, test):
    """The text of the line `// Slow: ...` above a test, or an empty string."""
    folder = ROOT / ("src" if binary == "lib" else f"tests/{binary}")
    name = test.rpartition("::")[2]
    for file in sorted(folder.rglob("*.rs")) if folder.is_dir() else [folder.with_suffix(".rs")]:
        lines = file.read_text().splitlines()
        for number, line in enumerate(lines):
            if re.search(rf"\bfn {re.escape(name)}\(", line):
                for above in reversed(lines[max(0, number - 8):number]):
                    if above.strip().startswith("// Slow: "):
                        return above.strip().removeprefix("// Slow: ")
                    if above.strip().startswith("}"):
                        break
    return ""


def timed(steps, name, action):
    print(f"== {name}", flush=True)
    start = time.monotonic()
    value = action()
    steps.append(Step(name, time.monotonic() - start))
    return value


def report(steps, results, total_s, full):
    print("\n   seconds  step")
    for step in steps:
        print(f"  {step.wall_s:8.1f}  {step.name}{step.note}")
    for binary in BINARIES:
        of_binary = [result for result in results if result.binary == binary]
        if of_binary:
            print(f"  {sum(r.wall_s for r in of_binary):8.1f}  {binary}: {len(of_binary)} tests, in parallel with others")
    print(f"  {total_s:8.1f}  in all")
    print("\n   seconds  slowest tests")
    for result in sorted(results, key=lambda r: -r.wall_s)[:SLOWEST_COUNT]:
        print(f"  {result.wall_s:8.1f}  {result.binary}::{result.test}")
    slow = [r for r in results if r.wall_s > SLOW_S]
    if slow and not full:
        print(f"\n   Above {SLOW_S:.0f} s, each with its reason:")
        for result in sorted(slow, key=lambda r: -r.wall_s):
            reason = reason_for_slow(result.binary, result.test) or "no line `// Slow: ...` above it"
            print(f"  {result.wall_s:8.1f}  {result.binary}::{result.test}: {reason}")


def main():
    parser = argparse.ArgumentParser(prog="scripts/test", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("filters", nargs="*", metavar="FILTER", type=Filter)
    parser.add_argument("--full", action="store_true", help="the full tier")
    args = parser.parse_args()
    begin, steps, failed_steps = time.monotonic(), [], []

    def check(name, *arguments):
        if timed(steps, name, lambda: cargo(*arguments)).returncode != 0:
            failed_steps.append(name)

    if not args.filters:
        check("format", "fmt", "--all", "--check")
    binaries, warnings = timed(steps, "build and lint", lambda: build(args.filters, bool(args.filters) and not args.full))
    if binaries is None:
        return 2
    if warnings and not args.filters:
        failed_steps.append(f"lint: {warnings} warnings")
    groups = []
    for binary in binaries:
        tests = binary.tests(args.full)
        if args.filters:
            tests = [test for test in tests if any(f.accepts(binary.name, test) for f in args.filters)]
        groups += grouped(binary, tests)
    if not groups:
        print("scripts/test: no test matches the filters", file=sys.stderr)
        return 2
    runner = Runner(groups, args.full)
    timed(steps, "tests", lambda: runner.run(os.cpu_count() or 1))
    if not args.filters:
        check("doc tests", "test", "--locked", "--workspace", "--doc")
        if args.full:
            # The engine and the program without the window and cameras.
            check("without default features", "check", "--locked", "--no-default-features")
    for log in runner.failures:
        print(f"\n{log}")
    results = runner.results
    report(steps, results, time.monotonic() - begin, args.full)
    failed_tests = [f"{r.binary}::{r.test}" for r in results if r.outcome == "FAILED"]
    for name in failed_tests + failed_steps:
        print(f"failed: {name}")
    passed = sum(r.outcome == "ok" for r in results)
    print(f"\n{passed} passed, {len(failed_tests) + len(failed_steps)} failed")
    return 1 if failed_tests or failed_steps else 0


if __name__ == "__main__":
    sys.exit(main())
