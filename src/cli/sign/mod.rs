//! `locard sign`: C2PA manifests of outputs, and their check.

mod check;
mod credentials;
mod manifest;
mod recorded;
mod time_stamp;

use std::fs::{File, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Result, anyhow, bail};
use c2pa::{Builder, Context, Signer};

use locard_engine::provenance::{bytes_digest, file_digest, output_of_record, record_path, sidecar_path};
use locard_engine::sink::atomic::{Partial, check_not_protected, stale_partials, write_atomically};
use locard_engine::source::file;
use locard_engine::text::{count, reason};

use super::{print_line, progress};
use check::{SignatureProblem, file_signature};
use credentials::{CredentialFiles, make_test_signer};
use manifest::{definition, media_type};
use recorded::{RecordedFile, RecordedOutput};
use time_stamp::StampedSigner;

#[derive(clap::Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Args {
    #[command(subcommand)]
    command: Option<SignCommand>,
    /// The output of `locard composite`, `join`, `photo` or `case-card`, with its record beside it
    #[arg(required = true)]
    output: Option<PathBuf>,
    /// The signer's private key, PKCS #8 in PEM form; by default that of `locard sign init`
    #[arg(long, value_name = "FILE", requires = "certificates")]
    key: Option<PathBuf>,
    /// The signer's certificate and those that it depends on, PEM
    #[arg(long, value_name = "FILE", requires = "key")]
    certificates: Option<PathBuf>,
    /// Have each signature stamped with the time by the authority at this address (RFC 3161); needs
    /// the program `curl`
    #[arg(long, value_name = "URL")]
    time_stamp: Option<String>,
    /// No progress bar
    #[arg(long, short)]
    quiet: bool,
}

#[derive(clap::Subcommand)]
enum SignCommand {
    /// Make a key and a certificate for trials, which no other program trusts
    Init {
        /// Name of the signer
        #[arg(long, default_value = "Test signer")]
        name: String,
        /// Folder of the files, instead of the one that `locard sign` reads
        #[arg(long, value_name = "DIR")]
        folder: Option<PathBuf>,
    },
    /// Check the signatures of an output, or of one file
    Check {
        /// The output, with its record beside it, or one file of it
        output: PathBuf,
        /// Certificates of authorities that you trust, PEM; others are refused
        #[arg(long, value_name = "FILE")]
        trust: Option<PathBuf>,
    },
}

pub fn run(args: &Args) -> Result<()> {
    match (&args.command, &args.output) {
        (Some(SignCommand::Init { name, folder }), _) => init(name, folder.as_deref()),
        (Some(SignCommand::Check { output, trust }), _) => check::check(output, trust.as_deref()),
        (None, Some(output)) => sign(args, output),
        (None, None) => bail!("no output is given: `locard sign OUTPUT`"),
    }
}

fn init(name: &str, folder: Option<&Path>) -> Result<()> {
    let signer = make_test_signer(name, folder)?;
    print_line(&format!("key           {}", signer.files.key.display()))?;
    print_line(&format!("certificates  {}", signer.files.certificates.display()))?;
    print_line(&format!("authority     {}, for `locard sign check --trust`", signer.authority.display()))
}

fn sign(args: &Args, output: &Path) -> Result<()> {
    let credentials = match (&args.key, &args.certificates) {
        (Some(key), Some(certificates)) => CredentialFiles { key: key.clone(), certificates: certificates.clone() },
        _ => CredentialFiles::of_test_signer()?,
    };
    let signer = StampedSigner::new(credentials.signer()?, args.time_stamp.clone());
    let record_file = record_path(&output_of_record(output).unwrap_or_else(|| output.to_owned()));
    // The record that is read is the one that is locked.
    let _lock = File::open(&record_file).ok().map(|file| lock(file, &record_file)).transpose()?;
    let output = RecordedOutput::read(output)?;
    let batch = SigningBatch {
        context: Arc::new(check::context(None)?),
        record_sha256: output.digest(),
        certificate_sha256: signer.certs()?.first().map(|certificate| bytes_digest(certificate)).unwrap_or_default(),
        signer: &signer,
        output: &output,
    };
    for path in output.files.iter().map(|file| &file.path).chain([&record_file]) {
        check_not_protected(path).map_err(|error| anyhow!("{}: {}", path.display(), reason(&error)))?;
    }
    output.files.iter().try_for_each(|file| batch.check_unchanged(file))?;
    remove_stale(output.files.iter().map(|file| &file.path).chain([&record_file]))?;
    let bar = progress(args.quiet, output.files.len());
    let mut digests = Vec::with_capacity(output.files.len());
    for file in &output.files {
        let sha256 = batch.sign(file).map_err(|error| match digests.len() {
            0 => error,
            number => anyhow!(
                "{error:#}; {number} of {} are signed, the same command completes them",
                count(output.files.len(), "file")
            ),
        })?;
        digests.push(sha256);
        bar.inc(1);
    }
    bar.finish_and_clear();
    // Signing changed the files; the signature covers the rest of the record.
    let text = output.text_with_digests(|file| &digests[file]);
    write_atomically(&record_file, true, |out| out.write_all(text.as_bytes()))?;
    print_line(&format!("{}: {} signed", output.path.display(), count(output.files.len(), "file")))
}

/// Removes unfinished files of a run that was killed. The lock on the record keeps other runs off
/// these files.
fn remove_stale<'a>(files: impl Iterator<Item = &'a PathBuf>) -> Result<()> {
    let named: Vec<PathBuf> = files.flat_map(|file| [file.clone(), sidecar_path(file)]).collect();
    let stale = stale_partials(named.iter().map(PathBuf::as_path));
    for path in &stale {
        std::fs::remove_file(path)
            .map_err(|error| anyhow!("{}: cannot be removed: {}", path.display(), reason(&error)))?;
    }
    match stale.len() {
        0 => Ok(()),
        number => print_line(&format!("removed: {} of an interrupted run", count(number, "unfinished file"))),
    }
}

/// An exclusive lock on a record, until the file is closed.
fn lock(file: File, path: &Path) -> Result<File> {
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => {
            bail!("{}: another `locard sign` is at work on it; wait for its end", path.display())
        }
        // A system without locks.
        Err(TryLockError::Error(_)) | Ok(()) => Ok(file),
    }
}

/// The signing of an output's files with one record by one signer.
struct SigningBatch<'a> {
    output: &'a RecordedOutput,
    signer: &'a StampedSigner,
    context: Arc<Context>,
    /// Digest of the record.
    record_sha256: String,
    /// Digest of the signer's certificate.
    certificate_sha256: String,
}

impl SigningBatch<'_> {
    /// Refuses a file that is not the recorded one. After an interrupted run a file may be signed
    /// already, with this record and by this signer.
    fn check_unchanged(&self, file: &RecordedFile) -> Result<()> {
        let path = file.path.display();
        let digest = file_digest(&file.path).map_err(|error| anyhow!("{path}: cannot be read: {}", reason(&error)))?;
        let is_recorded = digest.sha256 == file.sha256;
        let is_embedded = media_type(&file.path).1;
        let is_accepted = match file_signature(&file.path, &self.context) {
            Ok(signature) => {
                is_recorded
                    || (signature.record_sha256.as_ref() == Some(&self.record_sha256)
                        && signature.frame == file.frame
                        && signature.signer.fingerprint == self.certificate_sha256)
            }
            Err(SignatureProblem::Unreadable(_)) if !is_embedded => {
                let sidecar = sidecar_path(&file.path);
                bail!("{}: exists, and is no C2PA manifest; move it away", sidecar.display())
            }
            // The manifest beside an earlier video of this name.
            Err(SignatureProblem::Invalid { record_sha256, .. })
                if !is_embedded && record_sha256.as_ref() != Some(&self.record_sha256) =>
            {
                is_recorded
            }
            Err(SignatureProblem::Invalid { problem, .. }) => bail!("{path}: {problem}; composite it again"),
            Err(_) => is_recorded,
        };
        if !is_accepted {
            bail!("{path}: has changed since its record was written; only the recorded output is signed");
        }
        Ok(())
    }

    /// Embeds a manifest into a file, or writes it beside the file. Returns the file's digest.
    fn sign(&self, file: &RecordedFile) -> Result<String> {
        let described = |error: anyhow::Error| {
            let problem = match error.downcast_ref::<std::io::Error>() {
                Some(error) => reason(error),
                None => format!("{error:#}"),
            };
            anyhow!("{}", self.signer.failure().unwrap_or_else(|| format!("{}: {problem}", file.path.display())))
        };
        self.write_manifest(file).map_err(described)?;
        Ok(file_digest(&file.path).map_err(|error| described(error.into()))?.sha256)
    }

    fn write_manifest(&self, file: &RecordedFile) -> Result<()> {
        let (media_type, is_embedded) = media_type(&file.path);
        let definition = definition(self.output, file, &self.record_sha256);
        let mut builder = Builder::from_shared_context(&self.context).with_definition(definition)?;
        let mut source = file::open(&file.path)?;
        if !is_embedded {
            builder.set_no_embed(true);
            let manifest = builder.sign(self.signer, media_type, &mut source, &mut tempfile::tempfile()?)?;
            write_atomically(&sidecar_path(&file.path), true, |out| out.write_all(&manifest))?;
            return Ok(());
        }
        let mut partial = Partial::create(&file.path)?;
        builder.sign(self.signer, media_type, &mut source, partial.file())?;
        Ok(partial.finish(true)?)
    }
}
