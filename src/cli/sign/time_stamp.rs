//! Time stamps of signatures by an authority: RFC 3161.

use std::ffi::OsString;
use std::io::Write;
use std::sync::OnceLock;

use c2pa::crypto::cose::CertificateTrustPolicy;
use c2pa::crypto::time_stamp::verify_time_stamp;
use c2pa::status_tracker::StatusTracker;
use c2pa::{BoxedSigner, Error, Result, Signer, SigningAlg};

use locard_engine::program;

/// Bytes kept free for a time stamp with its certificates.
const STAMP_BYTES: usize = 20_000;
/// Longest wait for the authority, s.
const TIMEOUT_S: &str = "60";

/// A signer that requests a time stamp for each signature, if an authority is given. The program
/// `curl` sends the request.
pub struct StampedSigner {
    signer: BoxedSigner,
    authority: Option<String>,
    /// Why the authority gave no stamp: `c2pa` wraps it in words of its own. No memo: the first
    /// failure.
    failure: OnceLock<String>,
}

impl StampedSigner {
    pub fn new(signer: BoxedSigner, authority: Option<String>) -> Self {
        Self { signer, authority, failure: OnceLock::new() }
    }

    /// The reason why there is no stamp, after a failure.
    pub fn failure(&self) -> Option<String> {
        let authority = self.authority.as_ref()?;
        self.failure.get().map(|failure| format!("{authority}: no time stamp: {failure}"))
    }

    /// The authority's answer to a request, both in DER.
    fn answer(authority: &str, request: &[u8]) -> Result<Vec<u8>> {
        let mut body = tempfile::NamedTempFile::new()?;
        body.write_all(request)?;
        body.flush()?;
        let mut data = OsString::from("@");
        data.push(body.path());
        let options = [
            "--disable",
            "--proto",
            "=http,https",
            "--silent",
            "--show-error",
            "--fail",
            "--location",
            "--max-time",
            TIMEOUT_S,
        ];
        let header = ["--header", "Content-Type: application/timestamp-query", "--data-binary"];
        let arguments = options.into_iter().chain(header).map(OsString::from);
        let address = [OsString::from("--"), OsString::from(authority)];
        let arguments: Vec<OsString> = arguments.chain([data]).chain(address).collect();
        let answer = program::output("curl", &arguments);
        answer.map(|answer| answer.written).map_err(|error| Error::OtherError(Box::new(error)))
    }
}

impl Signer for StampedSigner {
    fn sign(&self, data: &[u8]) -> Result<Vec<u8>> {
        self.signer.sign(data)
    }

    fn alg(&self) -> SigningAlg {
        self.signer.alg()
    }

    fn certs(&self) -> Result<Vec<Vec<u8>>> {
        self.signer.certs()
    }

    fn reserve_size(&self) -> usize {
        self.signer.reserve_size() + if self.authority.is_some() { STAMP_BYTES } else { 0 }
    }

    fn send_timestamp_request(&self, message: &[u8]) -> Option<Result<Vec<u8>>> {
        let authority = self.authority.as_ref()?;
        let stamp = || {
            let stamp = Self::answer(authority, &self.timestamp_request_body(message)?)?;
            let policy = CertificateTrustPolicy::passthrough();
            verify_time_stamp(&stamp, message, &policy, &mut StatusTracker::default(), false)?;
            Ok(stamp)
        };
        let stamped: Result<Vec<u8>> = stamp();
        Some(stamped.inspect_err(|error| {
            // The first one is kept.
            let _ = self.failure.set(match error {
                Error::OtherError(of_curl) => of_curl.to_string(),
                other => format!("its answer is refused: {other}"),
            });
        }))
    }
}
