//! Signed outputs, and the detection of tampering.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::program::{locard, refused, stdout_of};
use locard::provenance::file_digest;

/// A folder with outputs and a test signer.
struct Case {
    folder: tempfile::TempDir,
}

impl Case {
    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn text(&self, name: &str) -> String {
        self.at(name).to_str().unwrap().to_owned()
    }

    /// `locard composite` of frames of the demonstration without shadows.
    fn composite(&self, frames: &str, output: &str) {
        let output = self.text(output);
        let arguments = ["composite", "recordings/demo", "--scene", "scenes/demo.toml", "--set", "shadow.cast=false"];
        let done = locard(&[&arguments[..], &["--frames", frames, "-q", "-o", &output]].concat());
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    }

    fn init(&self, folder: &str) {
        stdout_of(&["sign", "init", "--name", "A. Trainer", "--folder", &self.text(folder)]);
    }

    fn sign(&self, output: &str, signer: &str) {
        let (key, chain) = (self.text(&format!("{signer}/key.pem")), self.text(&format!("{signer}/certificates.pem")));
        stdout_of(&["sign", &self.text(output), "--key", &key, "--certificates", &chain, "-q"]);
    }

    /// The output of a check that fails.
    fn problems(&self, output: &str) -> String {
        let done = locard(&["sign", "check", &self.text(output)]);
        assert_eq!(done.status.code(), Some(2), "{output}: {}", String::from_utf8_lossy(&done.stdout));
        String::from_utf8(done.stdout).unwrap()
    }

    fn copy(&self, from: &str, to: &str) {
        fs::create_dir(self.at(to)).unwrap();
        for entry in fs::read_dir(self.at(from)).unwrap() {
            let path = entry.unwrap().path();
            fs::copy(&path, self.at(to).join(path.file_name().unwrap())).unwrap();
        }
        fs::copy(self.at(&format!("{from}.record.json")), self.at(&format!("{to}.record.json"))).unwrap();
    }
}

fn edit(file: &Path, change: impl FnOnce(&mut Vec<u8>)) {
    let mut bytes = fs::read(file).unwrap();
    change(&mut bytes);
    fs::write(file, bytes).unwrap();
}

fn position(bytes: &[u8], text: &[u8]) -> usize {
    bytes.windows(text.len()).position(|window| window == text).unwrap()
}

/// Replaces bytes by others of the same length.
fn replace(bytes: &mut [u8], old: &[u8], new: &[u8]) {
    let at = position(bytes, old);
    bytes[at..at + new.len()].copy_from_slice(new);
}

fn exchange(a: &Path, b: &Path) {
    let bytes = fs::read(a).unwrap();
    fs::copy(b, a).unwrap();
    fs::write(b, bytes).unwrap();
}

/// Removes a chunk of a PNG file.
fn remove_chunk(bytes: &mut Vec<u8>, kind: &[u8]) {
    let start = position(bytes, kind) - 4;
    let length = u32::from_be_bytes(bytes[start..start + 4].try_into().unwrap()) as usize;
    bytes.drain(start..start + length + 12);
}

#[test]
fn signed_frames_pass_and_each_kind_of_tampering_is_seen() {
    let case = Case { folder: tempfile::tempdir().unwrap() };
    case.init("me");
    case.init("other");
    case.composite("40..42", "a");
    case.sign("a", "me");
    let trust = case.text("me/authority.pem");
    let text = stdout_of(&["sign", "check", &case.text("a"), "--trust", &trust]);
    assert!(text.contains("signatures: 2 of 2 valid"), "{text}");
    assert!(text.contains("signer: A. Trainer (Locard test signer), certificate "), "{text}");
    assert!(text.contains(", trusted\n") && text.contains("stated: Composite with synthetic elements"), "{text}");
    // The record has the digests of the signed files.
    stdout_of(&["audit", &case.text("a"), "--files-only"]);

    let first = |folder: &Path| folder.join("frame_000040.png");
    let second = |folder: &Path| folder.join("frame_000041.png");
    type Tampering<'a> = (&'a str, &'a dyn Fn(&Path), &'a str);
    let tamperings: [Tampering; 11] = [
        ("byte", &|folder| edit(&first(folder), |bytes| *bytes.iter_mut().rev().nth(40).unwrap() ^= 1), "contents"),
        (
            "label",
            &|folder| edit(&first(folder), |bytes| replace(bytes, b"compositeSynthetic\"", b"digitalCapture\"    ")),
            "its contents have changed since it was signed",
        ),
        ("no manifest", &|folder| edit(&first(folder), |bytes| remove_chunk(bytes, b"caBX")), "has no signature"),
        (
            "statement",
            &|folder| edit(&first(folder), |bytes| replace(bytes, b"\"seed\":0", b"\"seed\":7")),
            "statements in its manifest have changed",
        ),
        ("appended", &|folder| edit(&first(folder), |bytes| bytes.extend(b"more")), "its contents have changed"),
        ("truncated", &|folder| edit(&first(folder), |bytes| bytes.truncate(bytes.len() / 2)), "frame_000040.png: "),
        (
            "exchanged",
            &|folder| exchange(&first(folder), &second(folder)),
            "was signed as frame 41, the record has it as frame 40",
        ),
        (
            "added",
            &|folder| _ = fs::copy(first(folder), folder.join("frame_000042.png")).unwrap(),
            "is not in the record",
        ),
        ("removed", &|folder| fs::remove_file(first(folder)).unwrap(), "frame_000040.png: cannot be read"),
        (
            "record",
            &|folder| {
                edit(&folder.with_extension("record.json"), |bytes| replace(bytes, b"\"seed\": 0", b"\"seed\": 7"))
            },
            "was signed with another record than the one beside it",
        ),
        (
            "digest",
            &|folder| {
                edit(&folder.with_extension("record.json"), |bytes| {
                    let at = position(bytes, b"\"file_sha256\":\"") + 15;
                    bytes[at] = if bytes[at] == b'0' { b'1' } else { b'0' };
                });
            },
            "differs from its digest in the record",
        ),
    ];
    for (name, tamper, problem) in tamperings {
        case.copy("a", name);
        tamper(&case.at(name));
        let text = case.problems(name);
        assert!(text.contains(problem), "{name}: {text}");
    }
    // A changed file with an adjusted digest is not signed again.
    case.copy("a", "laundered");
    edit(&first(&case.at("laundered")), |bytes| bytes.extend(b"more"));
    let [old, new] = ["a", "laundered"].map(|name| file_digest(&first(&case.at(name))).unwrap().sha256);
    edit(&case.at("laundered.record.json"), |bytes| replace(bytes, old.as_bytes(), new.as_bytes()));
    let (key, chain) = (case.text("me/key.pem"), case.text("me/certificates.pem"));
    let text = refused(&["sign", &case.text("laundered"), "--key", &key, "--certificates", &chain]);
    assert!(text.contains("its contents have changed since it was signed"), "{text}");
    let other_key = case.text("other/key.pem");
    let text = refused(&["sign", &case.text("a"), "--key", &other_key, "--certificates", &chain]);
    assert!(text.contains("is not the key of the certificate"), "{text}");
    stdout_of(&["sign", "check", &case.text("a/frame_000040.png"), "--trust", &trust]);

    case.copy("a", "resigned");
    case.sign("resigned", "other");
    let text = refused(&["sign", "check", &case.text("resigned"), "--trust", &trust]);
    assert!(text.contains("signed by somebody who is not trusted"), "{text}");
    // The record of another run, with the digests of these files.
    case.composite("40..42", "b");
    edit(&case.at("b.record.json"), |bytes| replace(bytes, b"/b\"", b"/c\""));
    case.copy("a", "sidecar");
    fs::copy(case.at("b.record.json"), case.at("sidecar.record.json")).unwrap();
    let text = case.problems("sidecar");
    assert!(text.contains("frame_000041.png: was signed with another record"), "{text}");
}

#[test]
fn interrupted_signing_is_completed_and_changed_files_are_not_signed() {
    let case = Case { folder: tempfile::tempdir().unwrap() };
    case.init("me");
    case.composite("40..42", "a");
    let record = fs::read(case.at("a.record.json")).unwrap();
    case.sign("a", "me");
    // As if the program had ended before the record was written.
    fs::write(case.at("a.record.json"), &record).unwrap();
    case.sign("a", "me");
    stdout_of(&["sign", "check", &case.text("a")]);

    case.composite("40..42", "b");
    edit(&case.at("b/frame_000040.png"), |bytes| bytes.extend(b"more"));
    let before = fs::read(case.at("b/frame_000041.png")).unwrap();
    let (key, chain) = (case.text("me/key.pem"), case.text("me/certificates.pem"));
    let text = refused(&["sign", &case.text("b"), "--key", &key, "--certificates", &chain]);
    assert!(text.contains("frame_000040.png: has changed since its record was written"), "{text}");
    assert_eq!(fs::read(case.at("b/frame_000041.png")).unwrap(), before);
    let text = refused(&["sign", &case.text("none"), "--key", &key, "--certificates", &chain]);
    assert!(text.contains("none.record.json: cannot be read"), "{text}");
}

#[test]
fn videos_are_signed_within_or_beside_them_and_still_play() {
    let case = Case { folder: tempfile::tempdir().unwrap() };
    case.init("me");
    for name in ["a.mp4", "a.mov", "b.mkv"] {
        case.composite("40..43", name);
        let frames = |name: &str| {
            let options = ["-v", "error", "-f", "framemd5", "-"];
            let done = Command::new("ffmpeg").arg("-i").arg(case.at(name)).args(options).output().unwrap();
            assert!(done.status.success() && done.stderr.is_empty());
            done.stdout
        };
        let before = frames(name);
        case.sign(name, "me");
        assert_eq!(frames(name), before, "{name}");
        stdout_of(&["sign", "check", &case.text(name)]);
        stdout_of(&["audit", &case.text(name), "--files-only"]);
        edit(&case.at(name), |bytes| {
            let middle = bytes.len() / 2;
            bytes[middle] ^= 1;
        });
        let text = case.problems(name);
        assert!(text.contains("its contents have changed"), "{name}: {text}");
    }
    assert!(case.at("b.c2pa").is_file());
    // The signature of another video.
    case.composite("40..42", "c.mkv");
    case.sign("c.mkv", "me");
    fs::copy(case.at("b.c2pa"), case.at("c.c2pa")).unwrap();
    assert!(case.problems("c.mkv").contains("its contents have changed"));
}
