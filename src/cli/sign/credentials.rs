//! Key and certificates of a signer.
//!
//! Sources: RFC 5280 (certificates), RFC 5958 (PKCS #8), and the C2PA Technical Specification,
//! section Certificate Profile.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

use anyhow::{Context, Result, anyhow, bail};
use c2pa::crypto::cose::{CertificateTrustPolicy, check_end_entity_certificate_profile};
use c2pa::crypto::raw_signature::validator_for_signing_alg;
use c2pa::status_tracker::StatusTracker;
use c2pa::{BoxedSigner, SigningAlg};
use p256::ecdsa::{DerSignature, SigningKey};
use p256::elliptic_curve::rand_core::{OsRng, RngCore};
use p256::pkcs8::EncodePrivateKey;
use x509_cert::Certificate;
use x509_cert::builder::{Builder, CertificateBuilder, Profile};
use x509_cert::der::asn1::ObjectIdentifier;
use x509_cert::der::pem::LineEnding;
use x509_cert::der::{Encode, EncodePem};
use x509_cert::ext::pkix::ExtendedKeyUsage;
use x509_cert::name::Name;
use x509_cert::serial_number::SerialNumber;
use x509_cert::spki::{AlgorithmIdentifierOwned, SubjectPublicKeyInfoOwned};
use x509_cert::time::Validity;

use locard_engine::provenance::bytes_digest;
use locard_engine::sink::SinkError;
use locard_engine::sink::atomic::write_atomically;
use locard_engine::source::file;
use locard_engine::text::reason;
use locard_engine::user_folders;

/// Largest file of a key or of certificates, bytes.
const MAX_PEM_BYTES: u64 = 1 << 20;

/// RFC 5480: an elliptic-curve key, and the curves P-256, P-384 and P-521.
const EC_KEY: ObjectIdentifier = ObjectIdentifier::new_unwrap("1.2.840.10045.2.1");
const P256: ObjectIdentifier = ObjectIdentifier::new_unwrap("1.2.840.10045.3.1.7");
const P384: ObjectIdentifier = ObjectIdentifier::new_unwrap("1.3.132.0.34");
const P521: ObjectIdentifier = ObjectIdentifier::new_unwrap("1.3.132.0.35");
/// RFC 8410.
const ED25519: ObjectIdentifier = ObjectIdentifier::new_unwrap("1.3.101.112");
/// RFC 4055: RSA keys, for any padding and for PSS alone.
const RSA: ObjectIdentifier = ObjectIdentifier::new_unwrap("1.2.840.113549.1.1.1");
const RSA_PSS: ObjectIdentifier = ObjectIdentifier::new_unwrap("1.2.840.113549.1.1.10");
/// RFC 5280, section 4.2.1.12: a purpose that the C2PA's profile accepts.
const EMAIL_PROTECTION: ObjectIdentifier = ObjectIdentifier::new_unwrap("1.3.6.1.5.5.7.3.4");

/// Files of a signer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CredentialFiles {
    /// The private key, PKCS #8.
    pub key: PathBuf,
    /// The signer's certificate, then those that it depends on.
    pub certificates: PathBuf,
}

impl CredentialFiles {
    fn in_folder(folder: &Path) -> Self {
        Self { key: folder.join("key.pem"), certificates: folder.join("certificates.pem") }
    }

    /// The files of the test signer of `locard sign init`.
    pub fn of_test_signer() -> Result<Self> {
        let folder = own_folder()?;
        let files = Self::in_folder(&folder);
        if !files.key.exists() {
            bail!(
                "no key: neither --key and --certificates, nor a test signer in {}; `locard sign init` makes one",
                folder.display()
            );
        }
        Ok(files)
    }

    /// Reads the files, and checks that they belong together.
    pub fn signer(&self) -> Result<BoxedSigner> {
        let (key, certificates) = (pem(&self.key)?, pem(&self.certificates)?);
        let of_file = || format!("{}", self.certificates.display());
        let chain = Certificate::load_pem_chain(&certificates)
            .map_err(|error| anyhow!("{error}; expected certificates in PEM form, the signer's first"))
            .with_context(of_file)?;
        let leaf = chain.first().ok_or_else(|| anyhow!("it has no certificate")).with_context(of_file)?;
        let key_info = &leaf.tbs_certificate.subject_public_key_info.algorithm;
        let algorithm = algorithm(key_info).with_context(of_file)?;
        self.check_key_form(&key)?;
        let signer = c2pa::create_signer::from_keys(&certificates, &key, algorithm, None).map_err(|error| {
            anyhow!(
                "{}: {error}; expected the private key of the certificate ({algorithm}), PKCS #8",
                self.key.display()
            )
        })?;
        // `c2pa` does not compare them.
        let message = b"locard";
        let key_info = leaf.tbs_certificate.subject_public_key_info.to_der()?;
        let validator = validator_for_signing_alg(algorithm).ok_or_else(|| anyhow!("{algorithm} cannot be checked"))?;
        validator.validate(&signer.sign(message)?, message, &key_info).map_err(|_| {
            anyhow!(
                "{}: is not the key of the certificate in {}; give the key that the certificate was issued for",
                self.key.display(),
                self.certificates.display()
            )
        })?;
        check_profile(leaf).with_context(of_file)?;
        Ok(signer)
    }

    /// Refuses keys in forms other than unencrypted PKCS #8.
    fn check_key_form(&self, key: &[u8]) -> Result<()> {
        let text = String::from_utf8_lossy(key);
        let problem = if text.contains("ENCRYPTED") {
            "the key is encrypted"
        } else if text.contains("-----BEGIN EC ") || text.contains("-----BEGIN RSA ") {
            "the key is in an older form"
        } else if !text.contains("-----BEGIN PRIVATE KEY-----") {
            "it has no private key"
        } else {
            return Ok(());
        };
        bail!(
            "{}: {problem}; expected an unencrypted private key in PKCS #8 form: `openssl pkcs8 -topk8 -nocrypt -in \
             KEY -out NEW` writes it",
            self.key.display()
        )
    }
}

/// Refuses a certificate that does not fit the C2PA's profile.
fn check_profile(certificate: &Certificate) -> Result<()> {
    let policy = CertificateTrustPolicy::default();
    let checked =
        check_end_entity_certificate_profile(&certificate.to_der()?, &policy, &mut StatusTracker::default(), None);
    checked.map_err(|error| {
        anyhow!(
            "{error}; expected a valid certificate by an authority, the signer's first, with the purpose e-mail \
             protection, document signing or C2PA claim signing; RSA of 2048 bits or more"
        )
    })
}

fn own_folder() -> Result<PathBuf> {
    let state = user_folders::state();
    let state = state.ok_or_else(|| anyhow!("the environment names no home folder; give --key and --certificates"))?;
    Ok(state.join("signing"))
}

fn pem(path: &Path) -> Result<Vec<u8>> {
    file::read(path, MAX_PEM_BYTES).map_err(|error| anyhow!("{}: cannot be read: {}", path.display(), reason(&error)))
}

/// The signature algorithm of a public key.
fn algorithm(key: &AlgorithmIdentifierOwned) -> Result<SigningAlg> {
    let curve = key.parameters.as_ref().and_then(|any| any.decode_as::<ObjectIdentifier>().ok());
    match (key.oid, curve) {
        (EC_KEY, Some(P256)) => Ok(SigningAlg::Es256),
        (EC_KEY, Some(P384)) => Ok(SigningAlg::Es384),
        (EC_KEY, Some(P521)) => Ok(SigningAlg::Es512),
        (ED25519, _) => Ok(SigningAlg::Ed25519),
        (RSA | RSA_PSS, _) => Ok(SigningAlg::Ps256),
        (EC_KEY, Some(curve)) => bail!("its curve is {curve}; expected P-256, P-384 or P-521"),
        (other, _) => bail!("its key is of the kind {other}; expected P-256, P-384, P-521, Ed25519 or RSA"),
    }
}

/// Digest of a certificate, as `openssl x509 -fingerprint -sha256` prints it without colons.
pub fn fingerprint(chain_pem: &str) -> Option<String> {
    let chain = Certificate::load_pem_chain(chain_pem.as_bytes()).ok()?;
    Some(bytes_digest(&chain.first()?.to_der().ok()?))
}

/// Whether a text has certificates in PEM form, all of them readable.
pub fn has_certificates(text: &str) -> bool {
    Certificate::load_pem_chain(text.as_bytes()).is_ok_and(|chain| !chain.is_empty())
}

/// Days of validity of a test signer, and of its authority.
const TEST_DAYS: u32 = 365;
const AUTHORITY_DAYS: u32 = 3650;
const DAY: Duration = Duration::from_secs(86_400);

/// The files of a test signer.
#[derive(Clone, Debug)]
pub struct TestSigner {
    pub files: CredentialFiles,
    /// The authority's certificate, for `locard sign check --trust`.
    pub authority: PathBuf,
}

/// Makes a key and a certificate by a test authority. The authority's own key is not kept. Existing
/// files are an error.
pub fn make_test_signer(name: &str, folder: Option<&Path>) -> Result<TestSigner> {
    let subject = subject(name)?;
    let folder = folder.map_or_else(own_folder, |folder| Ok(folder.to_owned()))?;
    let signer = TestSigner { files: CredentialFiles::in_folder(&folder), authority: folder.join("authority.pem") };
    for file in [&signer.files.key, &signer.files.certificates, &signer.authority] {
        if file.exists() {
            bail!("{}: exists and is kept; name another folder by --folder, or move it away", file.display());
        }
    }
    let invalid = |error: &dyn std::fmt::Display| anyhow!("the certificate cannot be made: {error}");
    let authority_name = Name::from_str("CN=Locard test authority").map_err(|error| invalid(&error))?;
    let (authority, own) = (SigningKey::random(&mut OsRng), SigningKey::random(&mut OsRng));
    let authority_certificate =
        certificate(Profile::Root, authority_name.clone(), AUTHORITY_DAYS, &authority, &authority)
            .map_err(|error| invalid(&error))?;
    let leaf = Profile::Leaf { issuer: authority_name, enable_key_agreement: false, enable_key_encipherment: false };
    let own_certificate = certificate(leaf, subject, TEST_DAYS, &own, &authority).map_err(|error| invalid(&error))?;
    let key = own.to_pkcs8_pem(LineEnding::LF).map_err(|error| invalid(&error))?;

    write(&signer.authority, authority_certificate.as_bytes())?;
    write(&signer.files.certificates, format!("{own_certificate}{authority_certificate}").as_bytes())?;
    write_private(&signer.files.key, key.as_bytes())?;
    Ok(signer)
}

/// The subject of a certificate. Separators of RFC 4514 are escaped.
fn subject(name: &str) -> Result<Name> {
    let refused = |why: &str| anyhow!("the name {name:?} is refused: {why}; expected a name as in --name 'A. Trainer'");
    if name.trim().is_empty() || name.chars().count() > 64 {
        return Err(refused("it has no or more than 64 characters"));
    }
    if name.chars().any(char::is_control) {
        return Err(refused("it has control characters"));
    }
    let escape = |c: char| if "\"+,;<>\\=#".contains(c) { format!("\\{c}") } else { c.to_string() };
    let escaped: String = name.trim().chars().map(escape).collect();
    Name::from_str(&format!("CN={escaped},O=Locard test signer")).map_err(|error| refused(&error.to_string()))
}

fn certificate(
    profile: Profile,
    subject: Name,
    days: u32,
    of: &SigningKey,
    by: &SigningKey,
) -> Result<String, Box<dyn std::error::Error + Send + Sync>> {
    let mut serial = [0; 8];
    OsRng.fill_bytes(&mut serial);
    // Positive, and of full length.
    serial[0] = serial[0] & 0x7f | 0x40;
    let is_leaf = matches!(profile, Profile::Leaf { .. });
    let key = SubjectPublicKeyInfoOwned::from_key(*of.verifying_key())?;
    let validity = Validity::from_now(DAY * days)?;
    let mut builder = CertificateBuilder::new(profile, SerialNumber::new(&serial)?, validity, subject, key, by)?;
    if is_leaf {
        builder.add_extension(&ExtendedKeyUsage(vec![EMAIL_PROTECTION]))?;
    }
    Ok(builder.build::<DerSignature>()?.to_pem(LineEnding::LF)?)
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), SinkError> {
    write_atomically(path, false, |out| out.write_all(bytes))
}

/// Writes a file that its owner alone may read.
fn write_private(path: &Path, bytes: &[u8]) -> Result<(), SinkError> {
    write_atomically(path, false, |out| {
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            out.get_ref().set_permissions(std::fs::Permissions::from_mode(0o600))?;
        }
        out.write_all(bytes)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn test_signer_signs_and_is_never_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let signer = make_test_signer("Ä. Trainer, \"Unit 5\"", Some(folder.path())).unwrap();
        let backend = signer.files.signer().unwrap();
        assert_eq!((backend.alg(), backend.certs().unwrap().len()), (SigningAlg::Es256, 2));
        let again = make_test_signer("B", Some(folder.path())).unwrap_err().to_string();
        assert!(again.contains("exists and is kept"), "{again}");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let mode = std::fs::metadata(&signer.files.key).unwrap().permissions().mode();
            assert_eq!(mode & 0o777, 0o600);
        }
    }

    #[test]
    fn wrong_credentials_are_refused_with_the_expected_form() {
        let folder = tempfile::tempdir().unwrap();
        let signer = make_test_signer("A", Some(folder.path())).unwrap();
        let refusal = |files: &CredentialFiles| format!("{:#}", files.signer().err().unwrap());
        let swapped = CredentialFiles { key: signer.files.certificates.clone(), ..signer.files.clone() };
        assert!(refusal(&swapped).contains("PKCS #8"), "{}", refusal(&swapped));
        let no_certificate = CredentialFiles { certificates: signer.files.key.clone(), ..signer.files.clone() };
        assert!(refusal(&no_certificate).contains("expected certificates in PEM form"), "{}", refusal(&no_certificate));
        let missing = CredentialFiles { key: folder.path().join("none"), ..signer.files.clone() };
        assert!(refusal(&missing).contains("none: cannot be read: "), "{}", refusal(&missing));
        let other = make_test_signer("O'Brien & (B_c/d), \"E\"", Some(&folder.path().join("other"))).unwrap();
        let mixed = CredentialFiles { key: other.files.key, ..signer.files.clone() };
        assert!(refusal(&mixed).contains("is not the key of the certificate"), "{}", refusal(&mixed));
        let encrypted = folder.path().join("encrypted.pem");
        std::fs::write(&encrypted, "-----BEGIN ENCRYPTED PRIVATE KEY-----\n").unwrap();
        let encrypted = CredentialFiles { key: encrypted, ..signer.files.clone() };
        assert!(refusal(&encrypted).contains("the key is encrypted"), "{}", refusal(&encrypted));
        assert!(make_test_signer(" ", Some(folder.path())).unwrap_err().to_string().contains("--name"));
    }
}
