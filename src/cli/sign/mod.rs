//! `locard sign`: C2PA manifests of outputs, and their check.

mod check;
mod credentials;
mod manifest;
mod recorded;
mod time_stamp;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Result, anyhow, bail};
use c2pa::{Builder, Context, Signer};

use locard_engine::provenance::{file_digest, record_path};
use locard_engine::sink::atomic::{Partial, write_atomically};
use locard_engine::source::file;
use locard_engine::text::{count, reason, shown};

use super::progress;
use check::{file_signature, sidecar_path};
use credentials::{CredentialFiles, make_test_signer};
use manifest::{definition, media_type};
use recorded::{RecordedFile, RecordedOutput};
use time_stamp::StampedSigner;

#[derive(clap::Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Args {
    #[command(subcommand)]
    command: Option<SignCommand>,
    /// The output of `locard composite` or `locard photo`, with its record beside it
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
        (None, None) => bail!("no output is given; `locard sign --help` has examples"),
    }
}

fn print_line(text: &str) -> Result<()> {
    Ok(writeln!(std::io::stdout(), "{}", shown(text))?)
}

fn init(name: &str, folder: Option<&Path>) -> Result<()> {
    let signer = make_test_signer(name, folder)?;
    print_line(&format!("key           {}", signer.files.key.display()))?;
    print_line(&format!("certificates  {}", signer.files.certificates.display()))?;
    print_line(&format!("authority     {}, for `locard sign check --trust`", signer.authority.display()))
}

fn sign(args: &Args, output: &Path) -> Result<()> {
    let output = RecordedOutput::read(output)?;
    let credentials = match (&args.key, &args.certificates) {
        (Some(key), Some(certificates)) => CredentialFiles { key: key.clone(), certificates: certificates.clone() },
        _ => CredentialFiles::own()?,
    };
    let signer = StampedSigner::new(credentials.signer()?, args.time_stamp.clone());
    let context = Arc::new(check::context(None)?);
    let digest = output.digest();
    for file in &output.files {
        check_unchanged(file, &digest, &context)?;
    }
    let bar = progress(args.quiet, output.files.len());
    let mut digests = Vec::with_capacity(output.files.len());
    for file in &output.files {
        let written = sign_file(&output, file, &digest, &signer, &context);
        written.map_err(|error| match signer.failure() {
            Some(failure) => anyhow!("{failure}"),
            None => error.context(format!("{}", file.path.display())),
        })?;
        let signed = file_digest(&file.path).map_err(|error| anyhow!("{}: {}", file.path.display(), reason(&error)))?;
        digests.push(signed.sha256);
        bar.inc(1);
    }
    bar.finish_and_clear();
    // Signing changed the files; the signature covers the rest of the record.
    let text = output.text_with_digests(|file| &digests[file]);
    write_atomically(&record_path(&output.path), true, |out| out.write_all(text.as_bytes()))?;
    print_line(&format!("{}: {} signed", output.path.display(), count(output.files.len(), "file")))
}

/// Refuses a file that is neither the recorded one nor signed with the record: an interrupted run
/// leaves signed files before the record has their digests.
fn check_unchanged(file: &RecordedFile, record_sha256: &str, context: &Arc<Context>) -> Result<()> {
    let path = file.path.display();
    let digest = file_digest(&file.path).map_err(|error| anyhow!("{path}: cannot be read: {}", reason(&error)))?;
    let is_signed = || {
        let signature = file_signature(&file.path, context);
        signature.is_ok_and(|signature| {
            signature.record_sha256.as_deref() == Some(record_sha256) && signature.frame == file.frame
        })
    };
    if digest.sha256 != file.sha256 && !is_signed() {
        bail!("{path}: has changed since its record was written; only the recorded output is signed");
    }
    Ok(())
}

/// Embeds a manifest into a file, or writes it beside the file.
fn sign_file(
    output: &RecordedOutput,
    file: &RecordedFile,
    record_sha256: &str,
    signer: &dyn Signer,
    context: &Arc<Context>,
) -> Result<()> {
    let (media_type, is_embedded) = media_type(&file.path);
    let mut builder = Builder::from_shared_context(context).with_definition(definition(output, file, record_sha256))?;
    let mut source = file::open(&file.path)?;
    if !is_embedded {
        let sidecar = sidecar_path(&file.path);
        let foreign = sidecar.exists() && file_signature(&file.path, context).is_err();
        if foreign {
            bail!("{}: exists, and is no signature of this file; move it away", sidecar.display());
        }
        builder.set_no_embed(true);
        let manifest = builder.sign(signer, media_type, &mut source, &mut tempfile::tempfile()?)?;
        write_atomically(&sidecar, true, |out| out.write_all(&manifest))?;
        return Ok(());
    }
    let mut partial = Partial::create(&file.path)?;
    builder.sign(signer, media_type, &mut source, partial.file())?;
    Ok(partial.finish(true)?)
}
