#!/usr/bin/env python3
"""Builds and runs the tests and reports the time of each step. Called by `scripts/test`.

    scripts/test                       format, lint and all tests of the fast tier
    scripts/test composite             one test binary
    scripts/test composite::laws       the tests of one module; lib::effects::noise are unit tests of src/effects/noise,
                                       lib::window::history those of src/window/history.rs
    scripts/test --full [FILTER ...]   the full tier, or parts of it

A filter is `BINARY` or `BINARY::PATH`, with the binaries `lib`, `architecture` and the folders of tests/. With a filter
only the binaries that it names are built; format and documentation are not checked, and clippy's warnings are no
failure. In the fast tier such a build is incremental, with the engine at opt-level 1, which shortens the loop of edit
and test.

Clippy runs as the compiler of the workspace's crates (RUSTC_WORKSPACE_WRAPPER, scripts/lint_once). This saves the
second pass over all dependencies that `cargo clippy` needs.

Test processes run side by side with one test thread each: a test that draws locks its process's only device, so
further threads would wait for it. Each module of a binary runs in a process of its own, whose tests share cached data.
A process without a result for ten minutes is killed.

Exit: 0 all passed or were skipped, 1 a test or check failed, 2 wrong usage, a filter without a test, or the build failed.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import threading
import time
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor

import testing
from testing import ROOT, Binary, CannotList, Filter, Result

# A test of the fast tier above this time needs a line `// Slow: REASON` above it.
SLOW_S = 5.0
# Number of slowest tests that are listed.
SLOWEST_COUNT = 10
# Profile of a build with filters, by package: in many small codegen units an edit invalidates few.
# No package is optimised more than in Cargo.toml.
LOOP_PROFILE = {
    "locard-engine": ["opt-level=1", "codegen-units=256"],
    "locard-window": ["codegen-units=256"],
    "locard": ["codegen-units=256"],
}


class Step:
    """A row of the table of times."""

    def __init__(self, name, wall_s, note=""):
        self.name, self.wall_s, self.note = name, wall_s, note


def cargo_environment(is_loop=False, **more):
    # Incremental data slows a full build down and helps only the next one.
    own = {"RUSTC_WORKSPACE_WRAPPER": str(ROOT / "scripts/lint_once"), "CARGO_INCREMENTAL": "1" if is_loop else "0"}
    return {**os.environ, **own, **more}


def cargo(*arguments, **more):
    return subprocess.run(["cargo", *arguments], cwd=ROOT, env=cargo_environment(**more))


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
        settings = [
            f"profile.dev.package.{package}.{setting}" for package, own in LOOP_PROFILE.items() for setting in own]
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
        if binary := Binary.of_message(message):
            binaries.append(binary)
    binaries.sort(key=lambda binary: testing.BINARIES.index(binary.name))
    return binaries if process.wait() == 0 else None, warnings


# The workspace of the fuzz targets, as options of cargo.
FUZZ = ["--manifest-path", "fuzz/Cargo.toml"]


def has_fuzz_dependencies(steps):
    """Downloads what only the fuzz targets need. Adds a row to the table of times if that fails."""
    # Versions of the workspace's own lock file; cargo adds libfuzzer-sys.
    shutil.copy(ROOT / "Cargo.lock", ROOT / "fuzz/Cargo.lock")
    if cargo("fetch", *FUZZ).returncode == 0:
        return True
    steps.append(Step("fuzz targets", 0.0, ": skipped, their dependencies cannot be downloaded"))
    return False


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
        self.environment = testing.environment(full)
        self.lock = threading.Lock()
        self.results, self.logs, self.problems = [], [], []

    def run(self, lanes):
        with ThreadPoolExecutor(lanes) as pool:
            runs = [(group, pool.submit(self.run_group, *group)) for group in self.groups]
        for (binary, name, _), done in runs:
            if error := done.exception():
                self.problems.append(f"{binary.name}::{name}: {type(error).__name__}: {error}")
        reported = {(result.binary, result.test) for result in self.results}
        for binary, _, tests in self.groups:
            self.results += [
                Result(binary.name, test, 0.0, "FAILED", "no result")
                for test in tests if (binary.name, test) not in reported]

    def run_group(self, binary, name, tests):
        start = time.monotonic()
        finished = testing.run(binary, tests, self.full, self.environment)
        failed = any(result.outcome == "FAILED" for result in finished.results)
        with self.lock:
            self.results += finished.results
            if failed or finished.problem:
                self.logs.append(finished.log)
            if finished.problem:
                self.problems.append(f"{binary.name}::{name}: {finished.problem}")
            mark = "FAILED" if failed or finished.problem else "ok    "
            print(f"{mark} {time.monotonic() - start:6.1f} s  {binary.name}::{name} ({len(tests)})", flush=True)


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
    for binary in testing.BINARIES:
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
            reason = testing.reason_for_slow(result.binary, result.test) or "no line `// Slow: ...` above it"
            print(f"  {result.wall_s:8.1f}  {result.binary}::{result.test}: {reason}")


def skips(results):
    """Prints the tests that were skipped, in whole or in part, with their reasons."""
    noted = [result for result in results if result.note and result.outcome in ("ok", "skipped")]
    if noted:
        print("\n   skipped tests, and tests that left a part out")
    for result in sorted(noted, key=lambda r: (r.outcome, r.binary, r.test)):
        print(f"  {result.binary}::{result.test}: {result.note}")


def scheduled(binaries, filters, full):
    """Groups of the tests to run. Ends the program if a binary is missing or a filter matches nothing."""
    missing = testing.expected(filters) - {(binary.name, binary.package) for binary in binaries}
    if missing:
        names = ", ".join(" of ".join(filter(None, pair)) for pair in sorted(missing))
        testing.fail("scripts/test", f"the build made no test binary {names}")
    groups, unmatched = [], list(filters)
    for binary in binaries:
        try:
            tests = binary.tests(full)
        except CannotList as error:
            testing.fail("scripts/test", f"the tests cannot be listed: {error}")
        if filters:
            unmatched = [f for f in unmatched if not any(f.accepts(binary.name, test) for test in tests)]
            tests = [test for test in tests if any(f.accepts(binary.name, test) for f in filters)]
        groups += grouped(binary, tests)
    if unmatched:
        tier = "full" if full else "fast"
        testing.fail("scripts/test", f"no test of the {tier} tier matches {', '.join(f.text for f in unmatched)}")
    return groups


def main():
    parser = argparse.ArgumentParser(prog="scripts/test", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("filters", nargs="*", metavar="FILTER", type=Filter)
    parser.add_argument("--full", action="store_true", help="the full tier")
    args = parser.parse_args()
    testing.kill_tests_when_ended()
    begin, steps, failed_steps = time.monotonic(), [], []

    def check(name, *arguments, **more):
        if timed(steps, name, lambda: cargo(*arguments, **more)).returncode != 0:
            failed_steps.append(name)

    if not args.filters:
        check("format", "fmt", "--all", "--check")
    binaries, warnings = timed(steps, "build and lint", lambda: build(args.filters, bool(args.filters) and not args.full))
    if binaries is None:
        return 2
    if warnings and not args.filters:
        failed_steps.append(f"lint: {warnings} warnings")
    runner = Runner(scheduled(binaries, args.filters, args.full), args.full)
    timed(steps, "tests", lambda: runner.run(os.cpu_count() or 1))
    if not args.filters:
        check("doc tests", "test", "--locked", "--workspace", "--doc")
        if args.full:
            check(
                "documentation", "doc", "--locked", "--workspace", "--no-deps", "--document-private-items",
                RUSTDOCFLAGS="--deny warnings --allow rustdoc::private_intra_doc_links")
            check("signing", "test", "--locked", "--features", "sign", "--lib", "--test", "files", "--", "sign")
            check("release build", "check", "--locked", "--release", "--workspace")
            # The features of scripts/demo: the engine and the program without the window and cameras.
            check("release build without default features", "check", "--locked", "--release", "--no-default-features")
            if has_fuzz_dependencies(steps):
                check("fuzz targets", "check", "--locked", *FUZZ)
    for log in runner.logs:
        print(f"\n{log}")
    results = runner.results
    report(steps, results, time.monotonic() - begin, args.full)
    skips(results)
    failed_tests = [
        f"{r.binary}::{r.test}{f': {r.note}' if r.note else ''}" for r in results if r.outcome == "FAILED"]
    failed = failed_tests + runner.problems + failed_steps
    for name in failed:
        print(f"failed: {name}")
    passed = sum(r.outcome == "ok" for r in results)
    skipped = sum(r.outcome == "skipped" for r in results)
    print(f"\n{passed} passed, {skipped} skipped, {len(failed)} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
