//! Checks the signatures of an output.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Result, anyhow, bail};
use c2pa::validation_results::StatusCodes;
use c2pa::validation_status::ValidationStatus;
use c2pa::{Context, Manifest, Reader, ValidationState};
use serde_json::{Value, json};

use locard_engine::label::DigitalSourceType;
use locard_engine::provenance::{output_of_record, record_path};
use locard_engine::sink::folder::is_frame_name;
use locard_engine::source::file;
use locard_engine::text::{count, reason, shown};

use super::credentials::fingerprint;
use super::manifest::{RECORD_ASSERTION, media_type};
use super::recorded::RecordedOutput;

/// Largest manifest beside a file, and largest file of trusted certificates, bytes.
const MAX_SIDECAR_BYTES: u64 = 1 << 26;

/// Status of a certificate that leads to no trusted authority.
const UNTRUSTED: &str = "signingCredential.untrusted";
/// Status of a time stamp whose authority is not trusted.
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

/// Contents of a valid signature.
#[derive(Clone, Debug)]
pub struct FileSignature {
    pub signer: SignerIdentity,
    /// Time by a time stamp authority, and whether that is trusted.
    pub stamp: Option<(String, bool)>,
    /// Digest of the record that was signed with the file.
    pub record_sha256: Option<String>,
    pub frame: Option<usize>,
    /// Name of the file when it was signed.
    pub title: String,
    /// Address of the digital source type of the last action.
    pub source_type: Option<String>,
}

/// Place of the manifest of a file that it cannot be embedded in: C2PA 2.2, section External
/// Manifests.
pub fn sidecar_path(file: &Path) -> PathBuf {
    file.with_extension("c2pa")
}

/// Settings of reading and of signing: nothing is fetched. `trusted`: authorities, PEM.
pub fn context(trusted: Option<&str>) -> Result<Context, c2pa::Error> {
    let mut settings = json!({ "verify": { "remote_manifest_fetch": false, "ocsp_fetch": false } });
    if let Some(anchors) = trusted {
        settings["trust"] = json!({ "user_anchors": anchors });
    }
    Context::new().with_settings(settings)
}

/// The signature of a file. The error is a description of the problem.
pub fn file_signature(path: &Path, context: &Arc<Context>) -> Result<FileSignature, String> {
    let (media_type, is_embedded) = media_type(path);
    let stream = file::open(path).map_err(|error| format!("cannot be read: {}", reason(&error)))?;
    let reader = Reader::from_shared_context(context);
    let read = if is_embedded {
        reader.with_stream(media_type, stream)
    } else {
        let sidecar = sidecar_path(path);
        let manifest = file::read(&sidecar, MAX_SIDECAR_BYTES)
            .map_err(|error| format!("has no signature: {} cannot be read: {}", sidecar.display(), reason(&error)))?;
        reader.with_manifest_data_and_stream(&manifest, media_type, stream)
    };
    let reader = read.map_err(|error| match error {
        c2pa::Error::JumbfNotFound => "has no signature".to_owned(),
        other => format!("its signature cannot be read: {other}"),
    })?;
    if let Some(failure) = first_failure(&reader) {
        return Err(problem(failure));
    }
    let manifest = match reader.validation_state() {
        ValidationState::Valid | ValidationState::Trusted => reader.active_manifest(),
        ValidationState::Invalid => None,
    };
    let manifest = manifest.ok_or_else(|| "its signature is not valid".to_owned())?;
    let mut signature = signature(manifest, reader.validation_state() == ValidationState::Trusted)?;
    if let (Some((_, is_trusted)), Some(codes)) = (&mut signature.stamp, status_codes(&reader)) {
        *is_trusted = !codes.informational().iter().any(|status| status.code() == UNTRUSTED_STAMP);
    }
    Ok(signature)
}

fn status_codes(reader: &Reader) -> Option<&StatusCodes> {
    reader.validation_results()?.active_manifest()
}

/// The first failure other than a certificate without a trusted authority.
fn first_failure(reader: &Reader) -> Option<&ValidationStatus> {
    status_codes(reader)?.failure().iter().find(|status| status.code() != UNTRUSTED)
}

/// A status code of the specification in words.
fn problem(status: &ValidationStatus) -> String {
    match status.code() {
        "assertion.dataHash.mismatch" | "assertion.bmffHash.mismatch" => {
            "its contents have changed since it was signed".to_owned()
        }
        "assertion.hashedURI.mismatch" | "assertion.missing" | "assertion.undeclared" => {
            "statements in its manifest have changed since it was signed".to_owned()
        }
        "claimSignature.mismatch" | "claimSignature.missing" => {
            "its signature does not belong to its manifest".to_owned()
        }
        "signingCredential.expired" | "claimSignature.outsideValidity" => {
            "its certificate was not valid at that time".to_owned()
        }
        code => format!("{} ({code})", status.explanation().unwrap_or("its signature is not valid")),
    }
}

fn signature(manifest: &Manifest, is_trusted: bool) -> Result<FileSignature, String> {
    let info = manifest.signature_info().ok_or_else(|| "its signature names no certificate".to_owned())?;
    let name = match (&info.common_name, &info.issuer) {
        (Some(name), Some(organisation)) => format!("{name} ({organisation})"),
        (Some(name), None) | (None, Some(name)) => name.clone(),
        (None, None) => "an unnamed certificate".to_owned(),
    };
    let signer = SignerIdentity {
        name,
        fingerprint: fingerprint(&info.cert_chain).unwrap_or_else(|| "unknown".to_owned()),
        is_trusted,
    };
    let record = manifest.find_assertion::<Value>(RECORD_ASSERTION).unwrap_or_default();
    let actions = manifest.find_assertion::<Value>("c2pa.actions").unwrap_or_default();
    let last = actions.get("actions").and_then(Value::as_array).and_then(|actions| actions.last());
    Ok(FileSignature {
        signer,
        stamp: info.time.clone().map(|time| (time, false)),
        record_sha256: record.get("sha256").and_then(Value::as_str).map(str::to_owned),
        frame: record.get("frame").and_then(Value::as_u64).map(|frame| frame as usize),
        title: manifest.title().unwrap_or_default().to_owned(),
        source_type: last.and_then(|action| action["digitalSourceType"].as_str()).map(str::to_owned),
    })
}

/// Longest list of files in full.
const MAX_LISTED: usize = 10;

/// Checks every file of an output, and prints the result. `trust`: file of trusted authorities.
pub fn check(path: &Path, trust: Option<&Path>) -> Result<()> {
    let anchors = trust.map(trusted).transpose()?;
    let context = context(anchors.as_deref()).map_err(|error| match trust {
        Some(trust) => anyhow!("{}: {error}; expected certificates in PEM form", trust.display()),
        None => error.into(),
    })?;
    let context = Arc::new(context);
    if let Some(alone) = file_without_record(path) {
        return check_file(&alone, &context, trust);
    }
    let output = RecordedOutput::read(path)?;
    let digest = output.digest();
    let mut problems = Vec::new();
    let mut signatures = Vec::new();
    for file in &output.files {
        let problem = match file_signature(&file.path, &context) {
            Err(problem) => Some(problem),
            Ok(signature) => {
                let problem = misplaced(&signature, file.frame, &digest, &file.path);
                signatures.push(signature);
                problem
            }
        };
        problems.extend(problem.map(|problem| format!("{}: {problem}", file.path.display())));
    }
    problems.extend(unrecorded(&output));
    report(&signatures, output.files.len(), trust)?;
    for problem in problems.iter().take(MAX_LISTED) {
        print_line(&format!("  {problem}"))?;
    }
    if problems.len() > MAX_LISTED {
        print_line(&format!("  and {} more", problems.len() - MAX_LISTED))?;
    }
    let signers: BTreeSet<_> = signatures.iter().map(|signature| &signature.signer).collect();
    let is_untrusted = trust.is_some() && signers.iter().any(|signer| !signer.is_trusted);
    match problems.len() {
        0 if is_untrusted => bail!("{}: signed by somebody who is not trusted", path.display()),
        0 => print_line(&format!("record: {} is as it was signed", record_path(&output.path).display())),
        number => bail!("{}: {} (listed above)", path.display(), count(number, "problem")),
    }
}

fn trusted(path: &Path) -> Result<String> {
    let text = file::read_text(path, MAX_SIDECAR_BYTES);
    let text = text.map_err(|error| anyhow!("{}: cannot be read: {}", path.display(), reason(&error)))?;
    if !text.contains("-----BEGIN CERTIFICATE-----") {
        bail!("{}: has no certificate; expected certificates of authorities in PEM form", path.display());
    }
    Ok(text)
}

/// A single file whose record is not beside it.
fn file_without_record(path: &Path) -> Option<PathBuf> {
    let is_alone = output_of_record(path).is_none() && path.is_file() && !record_path(path).exists();
    is_alone.then(|| path.to_owned())
}

fn check_file(path: &Path, context: &Arc<Context>, trust: Option<&Path>) -> Result<()> {
    let signature = file_signature(path, context).map_err(|problem| anyhow!("{}: {problem}", path.display()))?;
    let is_untrusted = trust.is_some() && !signature.signer.is_trusted;
    let frame = signature.frame.map(|frame| format!(", frame {frame}")).unwrap_or_default();
    let title = signature.title.clone();
    report(&[signature], 1, trust)?;
    print_line(&format!("signed as: {title}{frame}; its record is not beside it and was not checked"))?;
    if is_untrusted {
        bail!("{}: signed by somebody who is not trusted", path.display());
    }
    Ok(())
}

/// The problem of a valid signature of another file, or with another record.
fn misplaced(signature: &FileSignature, frame: Option<usize>, record_sha256: &str, path: &Path) -> Option<String> {
    if signature.record_sha256.is_none() {
        return Some("was signed without a record".to_owned());
    }
    if signature.frame != frame {
        let frame_text =
            |frame: Option<usize>| frame.map_or("another output".to_owned(), |frame| format!("frame {frame}"));
        return Some(format!(
            "was signed as {}, the record has it as {}",
            frame_text(signature.frame),
            frame_text(frame)
        ));
    }
    if signature.record_sha256.as_deref() != Some(record_sha256) {
        return Some("was signed with another record than the one beside it".to_owned());
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    // A folder may be renamed, and a video with its record; a frame's name is in the record.
    (frame.is_some() && signature.title != name).then(|| format!("was signed as {}", shown(&signature.title)))
}

/// Frames in the folder that the record does not have.
fn unrecorded(output: &RecordedOutput) -> Vec<String> {
    let recorded: BTreeSet<_> = output.files.iter().filter_map(|file| file.path.file_name()).collect();
    let entries = std::fs::read_dir(&output.path).into_iter().flatten().flatten().map(|entry| entry.file_name());
    let is_unrecorded =
        |name: &std::ffi::OsString| name.to_str().is_some_and(is_frame_name) && !recorded.contains(name.as_os_str());
    let mut names: Vec<_> = entries.filter(is_unrecorded).collect();
    names.sort();
    names.iter().map(|name| format!("{}: is not in the record", output.path.join(name).display())).collect()
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
    if let (Some((first, _)), Some((last, _))) = (stamps.first(), stamps.last()) {
        let times = if first == last { first.clone() } else { format!("{first} to {last}") };
        print_line(&format!(
            "time stamp: {times}, authority {}",
            trusted_text(stamps.iter().all(|(_, is)| *is), trust)
        ))?;
    }
    let source_types: BTreeSet<_> =
        signatures.iter().filter_map(|signature| signature.source_type.as_deref()).collect();
    source_types.into_iter().try_for_each(|uri| print_line(&format!("stated: {}", described(uri))))
}

fn trusted_text(is_trusted: bool, trust: Option<&Path>) -> &'static str {
    match (is_trusted, trust) {
        (true, _) => "trusted",
        (false, Some(_)) => "not trusted",
        (false, None) => "not compared with trusted ones (--trust FILE names them)",
    }
}

/// A digital source type in words, or its address.
fn described(uri: &str) -> &str {
    let all = [DigitalSourceType::CompositeWithSyntheticElements, DigitalSourceType::DigitalCreation];
    all.into_iter().find(|source_type| source_type.uri() == uri).map_or(uri, |source_type| source_type.description())
}

fn print_line(text: &str) -> Result<()> {
    Ok(writeln!(std::io::stdout(), "{}", shown(text))?)
}
