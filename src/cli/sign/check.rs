//! Checks the signatures of an output.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Result, anyhow, bail};
use c2pa::validation_results::StatusCodes;
use c2pa::validation_status::ValidationStatus;
use c2pa::{Context, Manifest, Reader, ValidationState};
use serde_json::{Value, json};

use locard_engine::label::DigitalSourceType;
use locard_engine::provenance::{file_digest, output_of_record, record_path, sidecar_path};
use locard_engine::sink::folder::frame_of_name;
use locard_engine::source::file;
use locard_engine::text::{count, reason, shown};

use super::super::{print_line, print_list};
use super::credentials::{fingerprint, has_certificates};
use super::manifest::{RECORD_ASSERTION, media_type};
use super::recorded::{RecordedFile, RecordedOutput};

/// Largest manifest beside a file, bytes.
const MAX_SIDECAR_BYTES: u64 = 1 << 26;
/// Largest file of trusted certificates, bytes.
const MAX_ANCHOR_BYTES: u64 = 1 << 24;

/// Problem of a file beside the recorded ones.
const NOT_RECORDED: &str = "not in the record";

/// Status of a certificate that leads to no trusted authority.
const UNTRUSTED: &str = "signingCredential.untrusted";
/// Statuses of a certificate outside of its validity.
const EXPIRED: [&str; 2] = ["signingCredential.expired", "claimSignature.outsideValidity"];
/// Status of a time stamp by an untrusted authority.
const UNTRUSTED_STAMP: &str = "timeStamp.untrusted";

/// Who signed a file.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct SignerIdentity {
    /// Name and organisation in the certificate.
    pub name: String,
    /// SHA-256 of the certificate.
    pub fingerprint: String,
    pub is_trusted: bool,
}

/// Time by a time stamp authority.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TimeStamp {
    /// As in 2026-11-30T20:39:13+00:00.
    pub time: String,
    pub is_trusted: bool,
}

/// Contents of a valid signature.
#[derive(Clone, Debug)]
pub struct FileSignature {
    pub signer: SignerIdentity,
    pub stamp: Option<TimeStamp>,
    /// Digest of the record that was signed with the file.
    pub record_sha256: Option<String>,
    pub frame: Option<usize>,
    /// Name of the file when it was signed.
    pub title: String,
    /// Address of the digital source type of the last action.
    pub source_type: Option<String>,
}

/// Why a file has no valid signature, in words that fit one file and several.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SignatureProblem {
    #[error("cannot be read: {0}")]
    File(String),
    #[error("no signature{0}")]
    Missing(String),
    #[error("unreadable signature: {0}")]
    Unreadable(String),
    #[error(
        "expired certificate, and no trusted time stamp shows that it was signed before; `--trust` names the authority \
         of time stamps, too"
    )]
    Expired,
    /// `record_sha256`: digest of the record that the manifest states.
    #[error("{problem}")]
    Invalid { problem: String, record_sha256: Option<String> },
}

/// Settings of reading and of signing: nothing is fetched. `trusted`: authorities, PEM.
pub fn context(trusted: Option<&str>) -> Result<Context, c2pa::Error> {
    let mut settings = json!({ "verify": { "remote_manifest_fetch": false, "ocsp_fetch": false } });
    if let Some(anchors) = trusted {
        settings["trust"] = json!({ "user_anchors": anchors });
    }
    Context::new().with_settings(settings)
}

/// The signature of a file.
pub fn file_signature(path: &Path, context: &Arc<Context>) -> Result<FileSignature, SignatureProblem> {
    let (media_type, is_embedded) = media_type(path);
    let stream = file::open(path).map_err(|error| SignatureProblem::File(reason(&error)))?;
    let reader = Reader::from_shared_context(context);
    let read = if is_embedded {
        reader.with_stream(media_type, stream)
    } else {
        let sidecar = sidecar_path(path);
        let manifest = file::read(&sidecar, MAX_SIDECAR_BYTES).map_err(|error| {
            SignatureProblem::Missing(format!(": {} cannot be read: {}", sidecar.display(), reason(&error)))
        })?;
        reader.with_manifest_data_and_stream(&manifest, media_type, stream)
    };
    let reader = read.map_err(|error| match error {
        c2pa::Error::JumbfNotFound => SignatureProblem::Missing(String::new()),
        other => SignatureProblem::Unreadable(other.to_string()),
    })?;
    let signature = reader.active_manifest().map(read_signature);
    let record_sha256 = || signature.as_ref().and_then(|signature| signature.record_sha256.clone());
    if let Some(failure) = first_failure(&reader) {
        if EXPIRED.contains(&failure.code()) {
            return Err(SignatureProblem::Expired);
        }
        return Err(SignatureProblem::Invalid { problem: failure_text(failure), record_sha256: record_sha256() });
    }
    let state = reader.validation_state();
    let valid = signature.clone().filter(|_| matches!(state, ValidationState::Valid | ValidationState::Trusted));
    let mut valid = valid.ok_or_else(|| SignatureProblem::Invalid {
        problem: "invalid signature".to_owned(),
        record_sha256: record_sha256(),
    })?;
    valid.signer.is_trusted = state == ValidationState::Trusted;
    if let (Some(stamp), Some(codes)) = (&mut valid.stamp, status_codes(&reader)) {
        stamp.is_trusted = !codes.informational().iter().any(|status| status.code() == UNTRUSTED_STAMP);
    }
    Ok(valid)
}

fn status_codes(reader: &Reader) -> Option<&StatusCodes> {
    reader.validation_results()?.active_manifest()
}

/// The first failure other than a certificate without a trusted authority.
fn first_failure(reader: &Reader) -> Option<&ValidationStatus> {
    status_codes(reader)?.failure().iter().find(|status| status.code() != UNTRUSTED)
}

/// A status code of the specification in words.
fn failure_text(status: &ValidationStatus) -> String {
    match status.code() {
        "assertion.dataHash.mismatch" | "assertion.bmffHash.mismatch" => "contents changed since signing".to_owned(),
        "assertion.hashedURI.mismatch" | "assertion.missing" | "assertion.undeclared" => {
            "statements of the manifest changed since signing".to_owned()
        }
        "claimSignature.mismatch" | "claimSignature.missing" => "signature of another manifest".to_owned(),
        code => format!("{} ({code})", status.explanation().unwrap_or("invalid signature")),
    }
}

/// The statements of a manifest; nobody and nothing is trusted yet.
fn read_signature(manifest: &Manifest) -> FileSignature {
    let info = manifest.signature_info();
    let name = match info.map(|info| (&info.common_name, &info.issuer)) {
        Some((Some(name), Some(organisation))) => format!("{name} ({organisation})"),
        Some((Some(name), None) | (None, Some(name))) => name.clone(),
        _ => "an unnamed certificate".to_owned(),
    };
    let fingerprint = info.and_then(|info| fingerprint(&info.cert_chain)).unwrap_or_else(|| "unknown".to_owned());
    let record = manifest.find_assertion::<Value>(RECORD_ASSERTION).unwrap_or_default();
    let actions = manifest.find_assertion::<Value>("c2pa.actions").unwrap_or_default();
    let last = actions.get("actions").and_then(Value::as_array).and_then(|actions| actions.last());
    FileSignature {
        signer: SignerIdentity { name, fingerprint, is_trusted: false },
        stamp: info.and_then(|info| info.time.clone()).map(|time| TimeStamp { time, is_trusted: false }),
        record_sha256: record.get("sha256").and_then(Value::as_str).map(str::to_owned),
        frame: record.get("frame").and_then(Value::as_u64).map(|frame| frame as usize),
        title: manifest.title().unwrap_or_default().to_owned(),
        source_type: last.and_then(|action| action["digitalSourceType"].as_str()).map(str::to_owned),
    }
}

/// Checks every file of an output, and prints the result. `trust`: file of trusted authorities.
pub fn check(path: &Path, trust: Option<&Path>) -> Result<()> {
    let anchors = trust.map(read_anchors).transpose()?;
    let context = Arc::new(context(anchors.as_deref())?);
    if let Some(file) = file_without_record(path) {
        return check_file(&file, &context, trust);
    }
    let output = RecordedOutput::read(path)?;
    let (signatures, problems) = check_files(&output, &context);
    report(&signatures, output.files.len(), trust)?;
    print_list(&grouped(&problems))?;
    refuse_untrusted(path, &signatures, trust)?;
    match problems.len() {
        0 => print_line(&format!("record: {} is as it was signed", record_path(&output.path).display())),
        number => bail!("{}: {} not as signed (listed above)", path.display(), count(number, "file")),
    }
}

/// The problem of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
struct FileProblem {
    path: PathBuf,
    frame: Option<usize>,
    text: String,
}

/// Lines about problems: one for each problem, with all frames that have it.
fn grouped(problems: &[FileProblem]) -> Vec<String> {
    let mut texts: Vec<&str> = Vec::new();
    for problem in problems {
        if !texts.contains(&problem.text.as_str()) {
            texts.push(&problem.text);
        }
    }
    let line = |text: &str| {
        let alike = problems.iter().filter(|problem| problem.text == text);
        let mut frames: Vec<usize> = alike.clone().filter_map(|problem| problem.frame).collect();
        frames.sort_unstable();
        match frames.as_slice() {
            [_, _, ..] => format!("{} ({}): {text}", count(frames.len(), "frame"), ranges(&frames)),
            _ => alike.map(|problem| format!("{}: {text}", problem.path.display())).collect::<Vec<_>>().join("; "),
        }
    };
    texts.into_iter().map(line).collect()
}

/// Numbers in order as text: `3 to 14, 17`.
fn ranges(numbers: &[usize]) -> String {
    let run = |run: &[usize]| match run {
        [first, .., last] => format!("{first} to {last}"),
        other => other.iter().map(usize::to_string).collect(),
    };
    numbers.chunk_by(|a, b| a + 1 == *b).map(run).collect::<Vec<_>>().join(", ")
}

/// The valid signatures of an output, and all problems.
fn check_files(output: &RecordedOutput, context: &Arc<Context>) -> (Vec<FileSignature>, Vec<FileProblem>) {
    let digest = output.digest();
    let (mut signatures, mut problems) = (Vec::new(), Vec::new());
    for file in &output.files {
        let problem = match file_signature(&file.path, context) {
            Err(problem) => Some(problem.to_string()),
            Ok(signature) => {
                let problem = placement_problem(&signature, file, &digest).or_else(|| digest_problem(file));
                signatures.push(signature);
                problem
            }
        };
        problems.extend(problem.map(|text| FileProblem { path: file.path.clone(), frame: file.frame, text }));
    }
    problems.extend(unrecorded_frames(output));
    (signatures, problems)
}

/// The problem of a file that differs from its digest in the record.
fn digest_problem(file: &RecordedFile) -> Option<String> {
    let is_equal = file_digest(&file.path).is_ok_and(|digest| digest.sha256 == file.sha256);
    (!is_equal).then(|| "other digest than in the record; if signing was interrupted, repeat `locard sign`".to_owned())
}

/// With a list of trusted authorities, all signers must be among them.
fn refuse_untrusted(path: &Path, signatures: &[FileSignature], trust: Option<&Path>) -> Result<()> {
    if trust.is_some() && signatures.iter().any(|signature| !signature.signer.is_trusted) {
        bail!("{}: signed by somebody who is not trusted", path.display());
    }
    Ok(())
}

/// Certificates of authorities, PEM.
fn read_anchors(path: &Path) -> Result<String> {
    let text = file::read_text(path, MAX_ANCHOR_BYTES);
    let text = text.map_err(|error| anyhow!("{}: cannot be read: {}", path.display(), reason(&error)))?;
    if !has_certificates(&text) {
        bail!("{}: has no certificate; expected certificates of authorities in PEM form", path.display());
    }
    Ok(text)
}

/// A single file that is checked without a record: its own or its folder's is missing.
fn file_without_record(path: &Path) -> Option<PathBuf> {
    let is_alone = output_of_record(path).is_none() && path.is_file() && !record_path(path).exists();
    is_alone.then(|| path.to_owned())
}

/// Checks a single file: a frame with the record of its folder, if there is one, otherwise the
/// signature alone.
fn check_file(path: &Path, context: &Arc<Context>, trust: Option<&Path>) -> Result<()> {
    let refused = |problem: String| anyhow!("{}: {problem}", path.display());
    let signature = file_signature(path, context).map_err(|problem| refused(problem.to_string()))?;
    let folder = path.parent().filter(|folder| record_path(folder).is_file());
    let output = folder.map(RecordedOutput::read).transpose()?;
    let title = signature.title.clone();
    let problem = output.as_ref().and_then(|output| {
        let file = output.files.iter().find(|file| file.path.file_name() == path.file_name());
        file.map_or(Some(NOT_RECORDED.to_owned()), |file| {
            placement_problem(&signature, file, &output.digest()).or_else(|| digest_problem(file))
        })
    });
    let signatures = [signature];
    report(&signatures, 1, trust)?;
    if let Some(problem) = problem {
        bail!(refused(problem));
    }
    match &output {
        Some(output) => print_line(&format!("record: {} has it", record_path(&output.path).display()))?,
        None => print_line(&format!("signed as: {title}; one file alone, its record was not checked"))?,
    }
    refuse_untrusted(path, &signatures, trust)
}

/// The problem of a valid signature of another file, or with another record.
fn placement_problem(signature: &FileSignature, file: &RecordedFile, record_sha256: &str) -> Option<String> {
    let frame = file.frame;
    if signature.record_sha256.is_none() {
        return Some("signed without a record".to_owned());
    }
    if signature.frame != frame {
        let frame_text =
            |frame: Option<usize>| frame.map_or("another output".to_owned(), |frame| format!("frame {frame}"));
        return Some(format!("signed as {}, recorded as {}", frame_text(signature.frame), frame_text(frame)));
    }
    if signature.record_sha256.as_deref() != Some(record_sha256) {
        return Some("signed with another record than the one there".to_owned());
    }
    let name = file.path.file_name().unwrap_or_default().to_string_lossy();
    // A folder may be renamed, and a video with its record; a frame's name is in the record.
    (frame.is_some() && signature.title != name).then(|| format!("signed as {}", shown(&signature.title)))
}

/// Frames in the folder that the record does not have.
fn unrecorded_frames(output: &RecordedOutput) -> Vec<FileProblem> {
    let recorded: BTreeSet<_> = output.files.iter().filter_map(|file| file.path.file_name()).collect();
    let entries = std::fs::read_dir(&output.path).into_iter().flatten().flatten().map(|entry| entry.file_name());
    let unrecorded = entries.filter(|name| !recorded.contains(name.as_os_str()));
    let mut frames: Vec<_> = unrecorded.filter_map(|name| Some((frame_of_name(name.to_str()?)?, name))).collect();
    frames.sort();
    let problem = |(frame, name)| FileProblem {
        path: output.path.join::<std::ffi::OsString>(name),
        frame: Some(frame),
        text: NOT_RECORDED.to_owned(),
    };
    frames.into_iter().map(problem).collect()
}

/// Prints who signed how many files, and when.
fn report(signatures: &[FileSignature], files: usize, trust: Option<&Path>) -> Result<()> {
    print_line(&format!("signatures: {} of {} valid", signatures.len(), files))?;
    let signers: BTreeSet<_> = signatures.iter().map(|signature| &signature.signer).collect();
    for signer in signers {
        let trusted = trusted_text(signer.is_trusted, trust);
        print_line(&format!("signer: {}, certificate {}, {trusted}", signer.name, signer.fingerprint))?;
    }
    let stamps: BTreeSet<_> = signatures.iter().filter_map(|signature| signature.stamp.as_ref()).collect();
    if let (Some(TimeStamp { time: first, .. }), Some(TimeStamp { time: last, .. })) = (stamps.first(), stamps.last()) {
        let times = if first == last { first.clone() } else { format!("{first} to {last}") };
        print_line(&format!(
            "time stamp: {times}, authority {}",
            trusted_text(stamps.iter().all(|stamp| stamp.is_trusted), trust)
        ))?;
    }
    let source_types: BTreeSet<_> =
        signatures.iter().filter_map(|signature| signature.source_type.as_deref()).collect();
    source_types.into_iter().try_for_each(|uri| print_line(&format!("stated: {}", source_type_text(uri))))
}

fn trusted_text(is_trusted: bool, trust: Option<&Path>) -> &'static str {
    match (is_trusted, trust) {
        (true, _) => "trusted",
        (false, Some(_)) => "not trusted",
        (false, None) => "not compared with trusted ones (--trust FILE names them)",
    }
}

/// A digital source type in words, or its address.
fn source_type_text(uri: &str) -> &str {
    let all = DigitalSourceType::ALL;
    all.into_iter().find(|source_type| source_type.uri() == uri).map_or(uri, |source_type| source_type.description())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn problems_are_grouped_by_their_text_with_ranges_of_frames() {
        let problem = |frame: usize, text: &str| FileProblem {
            path: format!("a/{frame}.png").into(),
            frame: Some(frame),
            text: text.to_owned(),
        };
        let mut problems: Vec<FileProblem> = (3..=14).chain([17, 19, 20]).map(|frame| problem(frame, "none")).collect();
        problems.insert(2, problem(40, "other"));
        let video = FileProblem { path: "a.mp4".into(), frame: None, text: "changed".to_owned() };
        problems.push(video);
        assert_eq!(
            grouped(&problems),
            ["15 frames (3 to 14, 17, 19 to 20): none", "a/40.png: other", "a.mp4: changed"]
        );
    }
}
