//! The `colmap` program: features, matches and the incremental model of a set of pictures
//! (Schönberger and Frahm 2016).

use std::ffi::OsString;
use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use super::error::{SolveError, SolveStage};
use crate::camera::Geometry;
use crate::program::{self, ProgramError};
use crate::recording::colmap::ColmapModel;

const PROGRAM: &str = "colmap";
/// Largest side of a picture in which features are detected, px.
const MAX_FEATURE_SIDE_PX: usize = 1600;
/// Number of successive pictures to which each one is matched, and at doubling distances beyond.
const SEQUENTIAL_OVERLAP: usize = 8;
/// Beginnings of the lines that report a step of each command.
const FEATURE_LINE: &str = "Processed file [";
const SEQUENTIAL_LINE: &str = "Matching image [";
const EXHAUSTIVE_LINE: &str = "Matching block [";
const MAPPING_LINE: &str = "Registering image #";
/// Smallest number of pictures of a model.
const MIN_MODEL_SIZE: usize = 3;

/// Selection of the pairs of pictures that are matched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PairMatching {
    /// Each with its successors.
    Sequential,
    /// Each with every other.
    Exhaustive,
}

/// The pictures, and the folder for the program's files.
#[derive(Debug)]
pub struct ColmapInputs<'a> {
    pub folder: &'a Path,
    pub images: &'a Path,
    /// Names of the pictures below `images`.
    pub names: &'a [String],
    pub matching: PairMatching,
    /// A known camera; it is not refined.
    pub camera: Option<&'a Geometry>,
}

/// Receives the stage, and how much of it is done. A break stops.
pub type ReportStage<'a> = &'a mut dyn FnMut(SolveStage, usize, usize) -> ControlFlow<()>;

/// First line of the program's help, with its version.
pub fn version() -> Result<String, ProgramError> {
    let help = program::output(PROGRAM, &["-h".into()])?.written;
    Ok(String::from_utf8_lossy(&help).lines().next().unwrap_or_default().trim().to_owned())
}

/// The models that the program finds, the one with most pictures first.
pub fn models(
    inputs: &ColmapInputs<'_>,
    options: &ColmapOptions,
    report: ReportStage<'_>,
) -> Result<Vec<ColmapModel>, SolveError> {
    let ColmapInputs { folder, images, names, .. } = *inputs;
    let list = folder.join("images.txt");
    let sparse = folder.join("sparse");
    fs::write(&list, names.join("\n") + "\n").map_err(SolveError::writing(&list))?;
    fs::create_dir(&sparse).map_err(SolveError::writing(&sparse))?;
    let database: PathBuf = folder.join("database.db");
    let path = |option: &str, path: &Path| [OsString::from(option), path.as_os_str().to_owned()];
    let database = || path("--database_path", &database);

    let mut features: Vec<OsString> = vec!["feature_extractor".into()];
    features.extend(database());
    features.extend(path("--image_path", images));
    features.extend(path("--image_list_path", &list));
    features.extend(options.extraction());
    features.extend(camera_options(inputs.camera)?);
    run(&features, names.len(), SolveStage::Features, FEATURE_LINE, report)?;

    let mut matches: Vec<OsString> = match inputs.matching {
        PairMatching::Exhaustive => vec!["exhaustive_matcher".into()],
        PairMatching::Sequential => ["sequential_matcher", "--SequentialMatching.overlap"].map(OsString::from).into(),
    };
    if inputs.matching == PairMatching::Sequential {
        matches.push(SEQUENTIAL_OVERLAP.to_string().into());
    }
    matches.extend(database());
    matches.extend(options.matching());
    let prefix = if inputs.matching == PairMatching::Sequential { SEQUENTIAL_LINE } else { EXHAUSTIVE_LINE };
    run(&matches, names.len(), SolveStage::Matches, prefix, report)?;

    let mut mapper: Vec<OsString> = vec!["mapper".into()];
    mapper.extend(database());
    mapper.extend(path("--image_path", images));
    mapper.extend(path("--output_path", &sparse));
    mapper.extend(["--Mapper.min_model_size".into(), MIN_MODEL_SIZE.to_string().into()]);
    if inputs.camera.is_some() {
        for name in ["ba_refine_focal_length", "ba_refine_extra_params"] {
            mapper.extend([format!("--Mapper.{name}").into(), "0".into()]);
        }
    }
    match run(&mapper, names.len(), SolveStage::Mapping, MAPPING_LINE, report) {
        // The mapper ends with an error if it finds no model.
        Err(SolveError::Program(ProgramError::Failed { .. })) if is_empty(&sparse) => {}
        other => other?,
    }
    read_models(&sparse)
}

fn is_empty(folder: &Path) -> bool {
    fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_none())
}

fn read_models(sparse: &Path) -> Result<Vec<ColmapModel>, SolveError> {
    let mut models = Vec::new();
    for entry in fs::read_dir(sparse).map_err(SolveError::writing(sparse))? {
        let folder = entry.map_err(SolveError::writing(sparse))?.path();
        if folder.is_dir() {
            models.push(ColmapModel::read_binary(&folder)?);
        }
    }
    models.sort_by_key(|model| std::cmp::Reverse(model.images.len()));
    Ok(models)
}

/// Runs one command. Its lines that begin with `prefix` are steps of the stage.
fn run(
    arguments: &[OsString],
    steps: usize,
    stage: SolveStage,
    prefix: &str,
    report: ReportStage<'_>,
) -> Result<(), SolveError> {
    let mut done = 0;
    if report(stage, done, steps).is_break() {
        return Err(SolveError::Stopped);
    }
    let mut on_line = |line: &str| match steps_done(line, prefix, steps, done) {
        Some(now) => {
            done = now;
            report(stage, done, steps)
        }
        None => ControlFlow::Continue(()),
    };
    match program::follow(PROGRAM, arguments, &mut on_line)? {
        Some(()) => Ok(()),
        None => Err(SolveError::Stopped),
    }
}

/// Number of completed steps after a line of the program; `None` for other lines. The line has a
/// fraction, as "Processed file [3/90]" or "Matching block [1/2, 2/2]", or is one more step, as
/// "Registering image #17 (3)".
fn steps_done(line: &str, prefix: &str, steps: usize, done: usize) -> Option<usize> {
    let (_, rest) = line.split_once(prefix)?;
    let fraction = rest.split([']', ',']).next()?.split_once('/');
    let fraction =
        fraction.and_then(|(part, all)| Some((part.trim().parse::<usize>().ok()?, all.trim().parse::<usize>().ok()?)));
    let now = match fraction {
        Some((part, all)) if all > 0 => part.saturating_mul(steps) / all,
        _ => done + 1,
    };
    Some(now.min(steps))
}

/// The installed version's names of options, and whether it uses a GPU.
#[derive(Debug)]
pub struct ColmapOptions {
    extraction: &'static str,
    matching: &'static str,
    has_cuda: bool,
}

impl ColmapOptions {
    pub fn of_installed() -> Result<Self, SolveError> {
        let help = |arguments: &[OsString]| -> Result<String, SolveError> {
            Ok(String::from_utf8_lossy(&program::output(PROGRAM, arguments)?.written).into_owned())
        };
        let banner = help(&["-h".into()])?;
        let extractor = help(&["feature_extractor".into(), "-h".into()])?;
        Ok(Self::of_help(&banner, &extractor))
    }

    fn of_help(banner: &str, extractor: &str) -> Self {
        // Renamed in COLMAP 3.12.
        let is_renamed = extractor.contains("--FeatureExtraction.use_gpu");
        let (extraction, matching) = match is_renamed {
            true => ("FeatureExtraction", "FeatureMatching"),
            false => ("SiftExtraction", "SiftMatching"),
        };
        Self { extraction, matching, has_cuda: banner.contains("with CUDA") }
    }

    /// Without CUDA its GPU code needs a screen.
    fn gpu(&self, table: &str) -> [OsString; 2] {
        [format!("--{table}.use_gpu").into(), u8::from(self.has_cuda).to_string().into()]
    }

    fn extraction(&self) -> Vec<OsString> {
        let size = [format!("--{}.max_image_size", self.extraction).into(), MAX_FEATURE_SIDE_PX.to_string().into()];
        self.gpu(self.extraction).into_iter().chain(size).collect()
    }

    fn matching(&self) -> [OsString; 2] {
        self.gpu(self.matching)
    }
}

/// One camera for all pictures: a known one, or one to refine.
fn camera_options(camera: Option<&Geometry>) -> Result<Vec<OsString>, SolveError> {
    let mut options: Vec<OsString> =
        ["--ImageReader.single_camera", "1", "--ImageReader.camera_model"].map(OsString::from).into();
    let Some(geometry) = camera else {
        // With more parameters the motion of a camera that mostly turns does not converge.
        options.push("SIMPLE_RADIAL".into());
        return Ok(options);
    };
    let (model, parameters) =
        crate::recording::colmap::camera_parameters(geometry).ok_or(SolveError::Lens(geometry.distortion.model))?;
    options.push(model.into());
    options.push("--ImageReader.camera_params".into());
    options.push(parameters.iter().map(f64::to_string).collect::<Vec<_>>().join(",").into());
    Ok(options)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_follows_the_lines_of_each_command() {
        let done = |line: &str, prefix: &str| steps_done(line, prefix, 90, 4);
        assert_eq!(done("Processed file [3/90]", FEATURE_LINE), Some(3));
        // As COLMAP logs since 3.9.
        assert_eq!(done("I20250101 12:00:00.1 7 pairing.cc:168] Matching image [45/90]", SEQUENTIAL_LINE), Some(45));
        assert_eq!(done("Matching block [1/2, 2/2] in 3.1s", EXHAUSTIVE_LINE), Some(45));
        assert_eq!(done("Registering image #17 (3)", MAPPING_LINE), Some(5));
        assert_eq!(steps_done("Registering image #17 (3)", MAPPING_LINE, 90, 90), Some(90));
        assert_eq!(done("  Features:        1214", FEATURE_LINE), None);
    }

    #[test]
    fn options_follow_the_installed_version() {
        let old =
            ColmapOptions::of_help("COLMAP 3.8 (Commit Unknown without CUDA)", "--SiftExtraction.use_gpu arg (=1)");
        assert_eq!(old.matching(), ["--SiftMatching.use_gpu", "0"].map(OsString::from));
        let new = ColmapOptions::of_help("COLMAP 3.13 (Commit abc with CUDA)", "--FeatureExtraction.use_gpu arg (=1)");
        assert_eq!(new.extraction()[..2], ["--FeatureExtraction.use_gpu", "1"].map(OsString::from));
    }
}
