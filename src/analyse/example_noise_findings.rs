//! Findings of noise by example, and the model's file beside an analysis.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::inputs::hex;
use crate::example_noise::file::{from_bytes, to_bytes};
use crate::example_noise::{NoiseModel, NoiseModelFile};
use crate::memo::ByAddress;
use crate::text::count;

/// How a frame's picture without noise is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ExampleOrigin {
    /// By the mean of its neighbours at the same points of the scene.
    #[default]
    Neighbours,
    /// By a smooth picture, in textureless places alone.
    Textureless,
    /// The mean of a stretch at rest is the noiseless picture.
    Rest,
}

/// Noise by example of a recording, without the model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExampleNoiseFindings {
    /// Why the recording has no noise by example.
    pub why: Option<String>,
    #[serde(default)]
    pub origin: ExampleOrigin,
    /// Number of frames that gave examples.
    pub frames: usize,
    /// Share of their pixels that were usable.
    pub usable_share: f64,
    /// Correlation of a frame's noise with that of the nearest frame, at the same points of the
    /// scene. Not drawn. `None` where it was not measured.
    pub frame_correlation: Option<f64>,
    /// SHA-256 of the model's file, hexadecimal.
    pub sha256: Option<String>,
}

impl fmt::Display for ExampleNoiseFindings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.sha256.is_none() {
            return write!(f, "none of noise: {}", self.why.as_deref().unwrap_or("no reason is given"));
        }
        let places = match self.origin {
            ExampleOrigin::Neighbours => "of their pixels, by neighbouring frames",
            ExampleOrigin::Textureless => "of their pixels, without texture",
            ExampleOrigin::Rest => "of their pixels, from a stretch at rest",
        };
        write!(f, "of noise, from {}, {:.0} % {places}", count(self.frames, "frame"), 100.0 * self.usable_share)?;
        match self.frame_correlation {
            Some(correlation) => write!(f, "; noise of neighbouring frames correlates by {correlation:.2}"),
            None => Ok(()),
        }
    }
}

/// The result of a search for examples.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ExampleNoiseEstimate {
    pub findings: ExampleNoiseFindings,
    /// The model's file; empty without one.
    pub file: Vec<u8>,
}

impl ExampleNoiseEstimate {
    pub fn of(
        model: &NoiseModel,
        origin: ExampleOrigin,
        frames: usize,
        usable_share: f64,
        frame_correlation: Option<f64>,
    ) -> Result<Self, String> {
        let file = to_bytes(model).map_err(|error| error.to_string())?;
        let sha256 = Some(hex(&Sha256::digest(&file)));
        let findings = ExampleNoiseFindings { why: None, origin, frames, usable_share, frame_correlation, sha256 };
        Ok(Self { findings, file })
    }

    pub fn none(why: impl Into<String>) -> Self {
        let why = Some(why.into());
        let findings = ExampleNoiseFindings {
            why,
            origin: ExampleOrigin::default(),
            frames: 0,
            usable_share: 0.0,
            frame_correlation: None,
            sha256: None,
        };
        Self { findings, file: Vec::new() }
    }
}

/// The file of a noise model, and the model.
#[derive(Clone, Debug)]
pub struct ExampleNoiseFile {
    pub bytes: Arc<[u8]>,
    pub example: NoiseModelFile,
}

impl PartialEq for ExampleNoiseFile {
    fn eq(&self, other: &Self) -> bool {
        self.bytes == other.bytes
    }
}

impl ExampleNoiseFile {
    /// `path`: that of the file. The error is the reason for which it is not usable.
    pub fn of(bytes: Vec<u8>, path: &Path) -> Result<Self, String> {
        let model = from_bytes(&bytes).map_err(|error| error.to_string())?;
        let example = NoiseModelFile { file: path.to_owned(), model: ByAddress(Arc::new(model)) };
        Ok(Self { bytes: bytes.into(), example })
    }
}
