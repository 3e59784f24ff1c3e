//! Signed outputs, and the detection of tampering.

use std::fs;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::program::{locard, program, refused, stdout_of};
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

    fn signing(&self, output: &str, signer: &str) -> Vec<String> {
        let file = |name: &str| self.text(&format!("{signer}/{name}"));
        let credentials = ["--key", &file("key.pem"), "--certificates", &file("certificates.pem"), "-q"];
        [&["sign", &self.text(output)], &credentials[..]].concat().into_iter().map(str::to_owned).collect()
    }

    /// Signs an output. Returns the program's output.
    fn sign(&self, output: &str, signer: &str) -> String {
        stdout_of(&self.signing(output, signer).iter().map(String::as_str).collect::<Vec<_>>())
    }

    /// The refusal to sign.
    fn refusal(&self, output: &str, signer: &str) -> String {
        refused(&self.signing(output, signer).iter().map(String::as_str).collect::<Vec<_>>())
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
            "contents changed since signing",
        ),
        (
            "no manifest",
            &|folder| edit(&first(folder), |bytes| remove_chunk(bytes, b"caBX")),
            "frame_000040.png: no signature",
        ),
        (
            "statement",
            &|folder| edit(&first(folder), |bytes| replace(bytes, b"\"seed\":0", b"\"seed\":7")),
            "statements of the manifest changed since signing",
        ),
        ("appended", &|folder| edit(&first(folder), |bytes| bytes.extend(b"more")), "contents changed since signing"),
        ("truncated", &|folder| edit(&first(folder), |bytes| bytes.truncate(bytes.len() / 2)), "frame_000040.png: "),
        ("exchanged", &|folder| exchange(&first(folder), &second(folder)), "signed as frame 41, recorded as frame 40"),
        (
            "added",
            &|folder| _ = fs::copy(first(folder), folder.join("frame_000042.png")).unwrap(),
            "frame_000042.png: not in the record",
        ),
        ("removed", &|folder| fs::remove_file(first(folder)).unwrap(), "frame_000040.png: cannot be read"),
        (
            "record",
            &|folder| {
                edit(&folder.with_extension("record.json"), |bytes| replace(bytes, b"\"seed\": 0", b"\"seed\": 7"))
            },
            "2 frames (40 to 41): signed with another record than the one there",
        ),
        (
            "digest",
            &|folder| {
                edit(&folder.with_extension("record.json"), |bytes| {
                    let at = position(bytes, b"\"file_sha256\":\"") + 15;
                    bytes[at] = if bytes[at] == b'0' { b'1' } else { b'0' };
                });
            },
            "other digest than in the record",
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
    let text = case.refusal("laundered", "me");
    assert!(text.contains("contents changed since signing"), "{text}");
    let chain = case.text("me/certificates.pem");
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
    assert!(text.contains("2 frames (40 to 41): signed with another record"), "{text}");
}

#[test]
fn interrupted_signing_is_completed_and_changed_files_are_not_signed() {
    let case = Case { folder: tempfile::tempdir().unwrap() };
    case.init("me");
    case.composite("40..42", "a");
    let record = fs::read(case.at("a.record.json")).unwrap();
    case.sign("a", "me");
    // As if the program had been killed before the record was written, in the middle of a frame.
    fs::write(case.at("a.record.json"), &record).unwrap();
    let [stale, other] = [40, 99].map(|frame| case.at(&format!("a/.frame_0000{frame}.partial-aB3xYz.png")));
    [&stale, &other].map(|file| fs::write(file, "half").unwrap());
    let text = case.sign("a", "me");
    assert!(text.starts_with("removed: 1 unfinished file of an interrupted run\n"), "{text}");
    assert!(!stale.exists() && other.exists(), "files of other names are kept");
    stdout_of(&["sign", "check", &case.text("a")]);

    case.composite("40..42", "b");
    edit(&case.at("b/frame_000040.png"), |bytes| bytes.extend(b"more"));
    let before = fs::read(case.at("b/frame_000041.png")).unwrap();
    let text = case.refusal("b", "me");
    assert!(text.contains("frame_000040.png: has changed since its record was written"), "{text}");
    assert_eq!(fs::read(case.at("b/frame_000041.png")).unwrap(), before);
    let text = case.refusal("none", "me");
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
        assert!(text.contains("contents changed since signing"), "{name}: {text}");
    }
    assert!(case.at("b.c2pa").is_file());
    // The signature of another video.
    case.composite("40..42", "c.mkv");
    case.sign("c.mkv", "me");
    fs::copy(case.at("b.c2pa"), case.at("c.c2pa")).unwrap();
    assert!(case.problems("c.mkv").contains("contents changed since signing"));
}

// Slow: a photograph, a card and two parts, each signed and checked by runs of the program.
#[test]
fn photographs_cards_and_joined_parts_are_signed_and_checked() {
    let case = Case { folder: tempfile::tempdir().unwrap() };
    case.init("me");
    let data = "case_number = \"1\"\ndate = \"2026\"\nplace = \"Office\"\nphotographer = \"A\"\n";
    fs::write(case.at("case.toml"), data).unwrap();
    stdout_of(&["case-card", &case.text("case.toml"), "-o", &case.text("card.jpg")]);
    let photo = ["photo", "recordings/demo", "--frame", "40", "--scene", "scenes/demo.toml", "--lux", "300", "-q"];
    let small = ["--set", "shadow.cast=false", "--width", "160", "-o", &case.text("photo.png")];
    stdout_of(&[&photo[..], &small].concat());
    case.composite("40..41", "parts/b");
    case.composite("41..42", "parts/a");
    stdout_of(&["join", &case.text("parts"), "-o", &case.text("joined"), "-q"]);
    let trust = case.text("me/authority.pem");
    for (output, stated) in [
        ("card.jpg", "Data-driven media: text and colour patches"),
        ("photo.png", "Composite with synthetic elements"),
        ("joined", "Composite with synthetic elements"),
    ] {
        case.sign(output, "me");
        let text = stdout_of(&["sign", "check", &case.text(output), "--trust", &trust]);
        assert!(text.contains(&format!("stated: {stated}")) && text.contains(", trusted\n"), "{output}: {text}");
        stdout_of(&["audit", &case.text(output), "--files-only"]);
    }
    assert!(fs::read(case.at("card.jpg")).unwrap().windows(15).any(|bytes| bytes == b"dataDrivenMedia"));
    // The parts' own files stay as they are.
    stdout_of(&["audit", &case.text("parts/a"), "--files-only"]);
    assert!(case.problems("parts/a").contains("frame_000041.png: no signature"));
    // Signatures of parts and of a replaced output.
    case.sign("parts/a", "me");
    let done = locard(&["join", &case.text("parts"), "-o", &case.text("joined"), "-q", "--force"]);
    let text = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success() && text.contains("joined: replaces a signed output; sign it again"), "{text}");
    assert!(text.contains("the parts are signed: their signatures are not valid for the joined output"), "{text}");
    edit(&case.at("card.jpg"), |bytes| *bytes.iter_mut().rev().nth(40).unwrap() ^= 1);
    assert!(case.problems("card.jpg").contains("card.jpg: contents changed since signing"));
}

#[cfg(unix)]
#[test]
fn protected_file_is_refused_and_the_target_of_a_link_is_signed() {
    let case = Case { folder: tempfile::tempdir().unwrap() };
    case.init("me");
    case.composite("40..42", "a");
    let (linked, protected) = (case.at("a/frame_000040.png"), case.at("a/frame_000041.png"));
    fs::rename(&linked, case.at("store.png")).unwrap();
    std::os::unix::fs::symlink(case.at("store.png"), &linked).unwrap();
    let writable = fs::metadata(&protected).unwrap().permissions();
    let mut read_only = writable.clone();
    read_only.set_readonly(true);
    fs::set_permissions(&protected, read_only).unwrap();
    let before = fs::read(case.at("store.png")).unwrap();
    let text = case.refusal("a", "me");
    assert!(text.contains("frame_000041.png: it is write-protected"), "{text}");
    assert_eq!(fs::read(case.at("store.png")).unwrap(), before, "no file is signed");
    fs::set_permissions(&protected, writable).unwrap();
    case.sign("a", "me");
    assert!(linked.is_symlink() && fs::read(case.at("store.png")).unwrap() != before);
    stdout_of(&["sign", "check", &case.text("a")]);
}

/// Runs `openssl` in a folder.
fn openssl(folder: &Path, arguments: &str) {
    let done = Command::new("openssl").args(arguments.split(' ')).current_dir(folder).output().unwrap();
    assert!(done.status.success(), "{arguments}: {}", String::from_utf8_lossy(&done.stderr));
}

/// Makes a time stamp authority: `root.pem` is trusted, `stamps.pem` signs by `stamps.key`.
fn make_stamp_authority(folder: &Path) {
    fs::create_dir(folder).unwrap();
    let write = |name: &str, text: &str| fs::write(folder.join(name), text).unwrap();
    write("serial", "01\n");
    write(
        "stamps.cnf",
        "[tsa]\ndefault_tsa = own\n[own]\nserial = serial\ndefault_policy = 1.2.3.4\n\
         digests = sha256, sha384, sha512\nsigner_digest = sha256\n",
    );
    write(
        "stamps.ext",
        "basicConstraints = critical, CA:FALSE\nkeyUsage = critical, digitalSignature\n\
         extendedKeyUsage = critical, timeStamping\nsubjectKeyIdentifier = hash\n\
         authorityKeyIdentifier = keyid\n",
    );
    openssl(folder, "req -x509 -newkey rsa:2048 -nodes -keyout root.key -out root.pem -days 9 -subj /CN=Root/O=Test");
    openssl(folder, "req -newkey rsa:2048 -nodes -keyout stamps.key -out stamps.csr -subj /CN=Stamps/O=Test");
    let sign = "x509 -req -in stamps.csr -CA root.pem -CAkey root.key -CAcreateserial -days 9 -extfile stamps.ext";
    openssl(folder, &format!("{sign} -out stamps.pem"));
}

/// Starts a local server and returns its address. If `answer` returns `None` for a request, the
/// connection is closed.
fn serve(answer: impl Fn(&[u8]) -> Option<Vec<u8>> + Send + 'static) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    let run = move || {
        for mut stream in listener.incoming().flatten() {
            if let Some(body) = answer(&read_request(&mut stream)) {
                respond(&mut stream, &body);
            }
        }
    };
    std::thread::Builder::new().spawn(run).unwrap();
    address
}

/// The body of a request.
fn read_request(stream: &mut TcpStream) -> Vec<u8> {
    let mut request = Vec::new();
    loop {
        let mut block = [0; 4096];
        let read_bytes = stream.read(&mut block).unwrap();
        assert!(read_bytes > 0, "the request ends early");
        request.extend_from_slice(&block[..read_bytes]);
        let Some(head_bytes) = request.windows(4).position(|bytes| bytes == b"\r\n\r\n") else { continue };
        let head = String::from_utf8_lossy(&request[..head_bytes]).to_ascii_lowercase();
        let length = head.lines().find_map(|line| line.strip_prefix("content-length: ")).unwrap();
        let body = &request[head_bytes + 4..];
        if body.len() >= length.parse::<usize>().unwrap() {
            return body.to_vec();
        }
    }
}

fn respond(stream: &mut TcpStream, body: &[u8]) {
    let head = format!("HTTP/1.1 200 OK\r\nContent-Length: {}\r\nConnection: close\r\n\r\n", body.len());
    stream.write_all(&[head.as_bytes(), body].concat()).unwrap();
}

/// The answer of `openssl ts` to a time stamp request.
fn stamp(folder: &Path, request: &[u8]) -> Vec<u8> {
    fs::write(folder.join("query"), request).unwrap();
    openssl(
        folder,
        "ts -reply -config stamps.cnf -queryfile query -signer stamps.pem -inkey stamps.key -chain root.pem -out reply",
    );
    fs::read(folder.join("reply")).unwrap()
}

#[test]
fn time_stamps_are_verified_and_a_silent_authority_stops_the_run() {
    let case = Case { folder: tempfile::tempdir().unwrap() };
    case.init("me");
    case.composite("40..42", "a");
    let authority = case.at("authority");
    make_stamp_authority(&authority);
    let sign = |address: &str| {
        let arguments = case.signing("a", "me");
        let mut command = program();
        command.env("NO_PROXY", "127.0.0.1").args(arguments).args(["--time-stamp", address]).output().unwrap()
    };
    let before = fs::read(case.at("a/frame_000040.png")).unwrap();
    let silent = serve(|_| None);
    let done = sign(&silent);
    let text = String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(2), "{text}");
    assert!(text.contains(&format!("{silent}: no time stamp: curl failed: ")), "{text}");
    assert_eq!(fs::read(case.at("a/frame_000040.png")).unwrap(), before);
    let text = String::from_utf8(sign(&serve(|_| Some(b"hello".to_vec()))).stderr).unwrap();
    assert!(text.contains("no time stamp: its answer is refused: "), "{text}");

    let folder = authority.clone();
    let done = sign(&serve(move |request| Some(stamp(&folder, request))));
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let stamp_line = |trust: &str| {
        let text = stdout_of(&["sign", "check", &case.text("a"), "--trust", trust]);
        text.lines().find(|line| line.starts_with("time stamp: 20")).unwrap().to_owned()
    };
    assert!(stamp_line(&case.text("me/authority.pem")).ends_with("authority not trusted"));
    let both = ["me/authority.pem", "authority/root.pem"].map(|name| fs::read_to_string(case.at(name)).unwrap());
    fs::write(case.at("both.pem"), both.concat()).unwrap();
    assert!(stamp_line(&case.text("both.pem")).ends_with("authority trusted"));
}
