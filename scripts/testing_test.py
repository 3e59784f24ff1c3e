#!/usr/bin/env python3
"""Tests of the test runner and of scripts/breaks, with small programs in place of test binaries. `scripts/hygiene` runs them."""

import contextlib
import importlib.machinery
import importlib.util
import io
import json
import os
import tempfile
import time
import unittest
import unittest.mock
from pathlib import Path

import run_tests
import testing
from testing import Binary, CannotList, Filter

# A test binary as libtest makes it: lists `a::one` and `a::two`, or runs the body.
PROGRAM = """#!/bin/sh
case " $* " in *" --list "*) case " $* " in *" --ignored "*) ;; *) echo 'a::one: test'; echo 'a::two: test';; esac; exit;; esac
{body}
"""
BOTH_PASS = "echo 'test a::one ... ok'; echo 'test a::two ... ok'"


class FakeBinaryTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def binary(self, body, name="live"):
        file = self.folder / "binary"
        file.write_text(PROGRAM.format(body=body))
        file.chmod(0o755)
        return Binary(name, str(file))


class RunnerTest(FakeBinaryTest):
    def run_all(self, binary, timeout_s=20.0):
        """Runs a binary's tests. Returns the runner and the outcomes by test."""
        runner = run_tests.Runner(run_tests.grouped(binary, binary.tests(False)), False)
        before, testing.TIMEOUT_S = testing.TIMEOUT_S, timeout_s
        with contextlib.redirect_stdout(io.StringIO()):
            runner.run(2)
        testing.TIMEOUT_S = before
        return runner, {result.test: result.outcome for result in runner.results}

    def test_passing_process_has_no_problem(self):
        runner, outcomes = self.run_all(self.binary(BOTH_PASS))
        self.assertEqual((runner.problems, outcomes), ([], {"a::one": "ok", "a::two": "ok"}))

    def test_exit_status_after_passed_tests_is_a_problem(self):
        runner, _ = self.run_all(self.binary(f"{BOTH_PASS}; exit 3"))
        self.assertEqual(runner.problems, ["live::a: ended with status 3 although no test failed"])

    def test_tests_after_an_abort_fail(self):
        runner, outcomes = self.run_all(self.binary("echo 'test a::one ... ok'; printf 'test a::two ... '; kill -ABRT $$"))
        self.assertEqual(outcomes, {"a::one": "ok", "a::two": "FAILED"})
        self.assertIn("running: a::two", runner.problems[0])

    def test_exception_in_a_lane_is_a_problem_and_its_tests_fail(self):
        binary = self.binary(BOTH_PASS)
        groups = run_tests.grouped(binary, binary.tests(False))
        Path(binary.file).unlink()
        runner = run_tests.Runner(groups, False)
        runner.run(2)
        self.assertIn("FileNotFoundError", runner.problems[0])
        self.assertEqual([result.outcome for result in runner.results], ["FAILED", "FAILED"])

    def test_hanging_test_is_killed_with_its_children_and_named(self):
        child = self.folder / "child"
        body = f"echo 'test a::one ... ok'; printf 'test a::two ... '; sleep 60 & echo $! > {child}; wait"
        start = time.monotonic()
        runner, outcomes = self.run_all(self.binary(body), timeout_s=1.0)
        self.assertLess(time.monotonic() - start, 20.0)
        self.assertEqual(runner.problems, ["live::a: no result for 1 s, killed; running: a::two"])
        self.assertEqual(outcomes, {"a::one": "ok", "a::two": "FAILED"})
        state = Path(f"/proc/{child.read_text().strip()}/stat")
        time.sleep(0.2)
        self.assertTrue(not state.exists() or state.read_text().split()[2] == "Z")

    def test_time_limit_restarts_with_each_result(self):
        runner, _ = self.run_all(self.binary("sleep 1; echo 'test a::one ... ok'; sleep 1; echo 'test a::two ... ok'"), 1.8)
        self.assertEqual(runner.problems, [])

    def test_skipped_tests_are_told_from_passed_ones(self):
        output = """
successes:

---- a::one stdout ----
skipped: LOCARD_DATA is not set, so there is no props

---- a::two stdout ----
left out: props

successes:
    a::one
    a::two

test result: ok."""
        runner, outcomes = self.run_all(self.binary(f"{BOTH_PASS}; cat <<'END'\n{output}\nEND"))
        self.assertEqual(outcomes, {"a::one": "skipped", "a::two": "ok"})
        table = io.StringIO()
        with contextlib.redirect_stdout(table):
            run_tests.skips(runner.results)
        self.assertIn("live::a::one: skipped: LOCARD_DATA", table.getvalue())
        self.assertIn("live::a::two: left out: props", table.getvalue())

    def test_output_between_a_test_and_its_result_is_no_result(self):
        _, outcomes = self.run_all(self.binary("printf 'test a::one ... '; echo; echo noise; echo ok; echo 'test a::two ... ok'"))
        self.assertEqual(outcomes, {"a::one": "ok", "a::two": "ok"})


class ScheduleTest(FakeBinaryTest):
    def refusal(self, binaries, *filters):
        """The message with which a schedule is refused, or an empty string."""
        errors = io.StringIO()
        try:
            with contextlib.redirect_stderr(errors):
                run_tests.scheduled(binaries, [Filter(text) for text in filters], False)
        except SystemExit as end:
            self.assertEqual(end.code, 2)
        return errors.getvalue()

    def test_binary_that_does_not_start_is_refused(self):
        (self.folder / "binary").write_text("#!/bin/sh\nexit 127\n")
        (self.folder / "binary").chmod(0o755)
        with self.assertRaises(CannotList):
            Binary("live", str(self.folder / "binary")).tests(False)
        with self.assertRaises(CannotList):
            Binary("live", str(self.folder / "nothing")).tests(False)

    def test_filter_without_a_test_is_refused_beside_one_that_matches(self):
        binary = self.binary(BOTH_PASS)
        self.assertEqual(self.refusal([binary], "live::a"), "")
        self.assertIn("no test of the fast tier matches live::b", self.refusal([binary], "live::a", "live::b"))

    def test_binary_that_was_not_built_is_refused(self):
        self.assertIn("made no test binary", self.refusal([self.binary(BOTH_PASS)]))
        self.assertIn("made no test binary files", self.refusal([self.binary(BOTH_PASS)], "live", "files"))
        self.assertIn("lib of locard-engine", self.refusal([self.binary(BOTH_PASS)], "live", "lib::effects"))


class BreaksTest(FakeBinaryTest):
    def setUp(self):
        super().setUp()
        loader = importlib.machinery.SourceFileLoader("breaks", str(testing.ROOT / "scripts/breaks"))
        self.breaks = importlib.util.module_from_spec(importlib.util.spec_from_loader("breaks", loader))
        loader.exec_module(self.breaks)
        self.breaks.WORK = self.breaks.TREE = self.folder
        self.breaks.FIXTURES = self.folder / "fixtures"

    def detected_by(self, body, timeout_s=20.0):
        """The test that detects a break with which the binary runs this body."""
        binary = self.binary(f'if [ -z "$LOCARD_BREAK" ]; then {BOTH_PASS}; exit; fi; {body}')
        of_break = self.breaks.Break("name", "file", "find", "replace", "expect", ["live::a"])
        before, testing.TIMEOUT_S = testing.TIMEOUT_S, timeout_s
        with contextlib.redirect_stdout(io.StringIO()):
            row = self.breaks.try_break(of_break, self.breaks.Tests([binary], "fast", "tree"), False)
        testing.TIMEOUT_S = before
        return row.detected_by

    def test_failure_hang_and_abort_are_detections(self):
        self.assertIsNone(self.detected_by(BOTH_PASS))
        self.assertEqual(self.detected_by("echo 'test a::one ... FAILED'; sleep 60"), "live::a::one")
        self.assertIn("running: a::one", self.detected_by("printf 'test a::one ... '; sleep 60", 1.0))
        self.assertIn("status", self.detected_by("echo 'test a::one ... ok'; exit 9"))

    def test_baseline_belongs_to_a_tree_and_to_recordings(self):
        binary = self.binary(BOTH_PASS)
        tests = self.breaks.Tests([binary], "fast", "tree")
        with contextlib.redirect_stdout(io.StringIO()):
            tests.passing("live")
        self.assertEqual(len(self.breaks.Tests([binary], "fast", "tree").sound), 2)
        self.assertEqual(self.breaks.Tests([binary], "fast", "other").sound, {})
        with unittest.mock.patch.dict(os.environ, LOCARD_DATA="other"):
            self.assertEqual(self.breaks.Tests([binary], "fast", "tree").sound, {})
        key = json.loads((self.folder / "sound-fast.json").read_text())["key"]
        self.assertEqual(key["tree"], "tree")

    def test_filter_without_a_test_is_a_problem(self):
        self.assertIsNone(self.breaks.filter_problem("composite::laws"))
        self.assertIn("no module or test", self.breaks.filter_problem("composite::laws::none"))
        self.assertIn("names no test binary", self.breaks.filter_problem("program::cli"))


class SourceTest(unittest.TestCase):
    def test_source_is_found_by_the_path_of_a_test(self):
        file, line = testing.source_of("architecture", "imports_of_every_cycle_are_found")
        self.assertIn("fn imports_of_every_cycle_are_found", file.read_text().splitlines()[line])
        self.assertIsNone(testing.source_of("composite", "laws::no_such_test"))
        self.assertIsNone(testing.source_of("composite", "no_such_module"))
        self.assertEqual(testing.source_of("lib", "window::history")[0], testing.ROOT / "src/window/history.rs")

    def test_reason_belongs_to_the_test_of_that_path(self):
        with tempfile.TemporaryDirectory() as folder:
            root, testing.ROOT = testing.ROOT, Path(folder)
            self.addCleanup(setattr, testing, "ROOT", root)
            os.makedirs(f"{folder}/tests/live")
            for name, reason in (("a", "first"), ("b", "second")):
                text = f"// Slow: {reason}\n#[test]\nfn same() {{}}\n\n#[test]\nfn quick() {{}}\n"
                Path(f"{folder}/tests/live/{name}.rs").write_text(text)
            Path(f"{folder}/tests/live/main.rs").write_text("mod a;\nmod b;\n")
            self.assertEqual(testing.reason_for_slow("live", "b::same"), "second")
            self.assertEqual(testing.reason_for_slow("live", "b::quick"), "")


if __name__ == "__main__":
    unittest.main()
