//! `locard site`: puts a scan of the place into a scene, aligned with the recording.

use std::io::Write;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;

use super::analysis::AnalysisArgs;
use super::pick::{numbers, of_view, view};
use super::warn;
use anyhow::{Context, Result, anyhow, bail};
use locard_engine::export::Inputs;
use locard_engine::pose::Pose;
use locard_engine::recording::{OpenOptions, Recording};
use locard_engine::scene::{self, Document, SceneFile, SiteTable};
use locard_engine::shot::{PickedPair, Shot, ShotOptions, SiteByPairs};
use locard_engine::sink::{self, atomic::write_atomically};
use locard_engine::site::refinement::PosePrior;
use locard_engine::site::{ScannedSite, SiteScan};
use locard_engine::text::{count, fixed, number};

#[derive(clap::Args)]
pub struct Args {
    /// The recording
    recording: PathBuf,
    /// The scan: E57, LAS, LAZ, PLY, OBJ, STL, glTF, or columns of text (XYZ, PTS, TXT, CSV)
    #[arg(long, value_name = "FILE")]
    scan: PathBuf,
    /// The scene file to add it to; created if it does not exist
    #[arg(long)]
    scene: PathBuf,
    /// A point of the scan (m, or the scan's unit) and where a frame shows it; three or more,
    /// spread over the place
    #[arg(long = "pair", value_name = "FRAME:X,Y=X,Y,Z", value_parser = parse_pair, allow_hyphen_values = true)]
    pairs: Vec<PickedPair>,
    /// Length of the scan's unit, for formats without one (PLY, OBJ, STL), m
    #[arg(long, value_name = "M")]
    scan_unit: Option<f64>,
    /// Find the length of the recording's unit by the scan, for formats without a scale (COLMAP,
    /// nerfstudio …); needs four pairs in frames from several positions
    #[arg(long)]
    find_scale: bool,
    /// Keep the pose of the pairs; by default it is refined by the frames' pictures
    #[arg(long)]
    no_refine: bool,
    /// The camera, if the recording lacks it
    #[arg(long)]
    profile: Option<PathBuf>,
    /// Length of a unit, for formats without a scale (nerfstudio, COLMAP, Metashape …)
    #[arg(long, value_name = "M", default_value_t = 1.0, conflicts_with = "find_scale")]
    metres_per_unit: f64,
    #[command(flatten)]
    analysis: AnalysisArgs,
}

fn parse_pair(text: &str) -> Result<PickedPair, String> {
    const EXPECTED: &str = "FRAME:X,Y=X,Y,Z, as in 40:210,330=1.25,0.31,0.02";
    let (of_frame, of_scan) = text.split_once('=').ok_or_else(|| format!("{text}: expected {EXPECTED}"))?;
    Ok(PickedPair { view: view(of_frame, EXPECTED)?, point: numbers::<3>(of_scan, "1.25,0.31,0.02")?.into() })
}

/// The pose of a scan, and its origin.
struct ScanPlacement {
    world_from_scan: Pose,
    /// Factor on the recording's unit, if it was to be found.
    unit_factor: Option<f64>,
    prior: PosePrior,
}

pub fn run(args: &Args) -> Result<()> {
    if !args.scene.extension().unwrap_or_default().eq_ignore_ascii_case("toml") {
        bail!("--scene {}: the name of a scene file ends in .toml", args.scene.display());
    }
    if let Some(odd) = args.scan_unit.filter(|unit| !(*unit > 0.0 && unit.is_finite())) {
        bail!("--scan-unit {}: expected more than 0 metres", number(odd));
    }
    let (mut shot, mut document) = open(args)?;
    let mut file = document.value().clone();
    let scan = Arc::new(scene::read_scan(&args.scan, args.scan_unit)?);
    scan.warnings.iter().for_each(|text| warn(false, text));
    let mut out = std::io::stdout().lock();
    writeln!(out, "scan       {}", scan.description())?;
    let placement = scan_pose(args, &shot, &scan, file.site.as_ref(), &mut out)?;
    if let Some(factor) = placement.unit_factor {
        let unit_m = shot.set_unit_of_site(&mut file, factor);
        let unit_m = unit_m.map_err(|error| anyhow!("--find-scale: {error}"))?;
        writeln!(out, "unit       {} m, written into the scene file", number(unit_m))?;
    }
    let mut site = ScannedSite::new(scan, placement.world_from_scan);
    if !args.no_refine {
        match shot.refined_site(&site, placement.prior, &mut |_| ControlFlow::Continue(()))? {
            Ok(refined) => {
                writeln!(out, "refined    {refined}")?;
                site = refined.site;
            }
            Err(why) => writeln!(out, "refined    not: {why}")?,
        }
    }
    if let Some(advice) = shot.site_doubt(&site) {
        writeln!(out, "odd        {advice}")?;
    }
    let pose = site.world_from_scan;
    let gauge_frame = args.pairs.first().map(|pair| pair.view.frame);
    let scan_name = scene::relative(&args.scan, &args.scene);
    if let Some(up) = shot.put_site(&mut file, &site, scan_name, args.scan_unit, gauge_frame) {
        writeln!(
            out,
            "up         [{}], the scan's, is written into the scene file",
            up.map(|n| fixed(n, 4)).join(", ")
        )?;
    }
    document.set(file).context("the scene file")?;
    write_atomically(&args.scene, true, |out| out.write_all(document.to_string().as_bytes()))?;
    let position = pose.translation_m.to_array().map(|n| fixed(n, 4)).join(" ");
    writeln!(out, "site       origin at {position} m, written into {}", args.scene.display())?;
    Ok(())
}

fn open(args: &Args) -> Result<(Shot, Document)> {
    let options = OpenOptions { metres_per_unit: args.metres_per_unit, ..OpenOptions::default() };
    let recording = Recording::open(&args.recording, &options)?;
    let exists = args.scene.exists();
    // An analysis with the scene's present scan fits only with that scan.
    let present = exists.then(|| scene::load(&args.scene, recording.up)).transpose()?.and_then(|scene| scene.site);
    let scene = present.filter(|site| site.scan.exists()).map(|_| args.scene.clone());
    let shot_options = ShotOptions {
        scene,
        profile: args.profile.clone(),
        analysis: args.analysis.choice(),
        ..ShotOptions::default()
    };
    let (mut shot, ()) = args.analysis.open(recording, &shot_options, false, |_| Ok(()))?;
    shot.unused_analysis_note().iter().for_each(|note| warn(false, &note.to_string()));
    let document = if exists {
        scene::document::read(&args.scene)?
    } else {
        Inputs::of(&shot).check_file(&args.scene)?;
        sink::check_file(&args.scene, false)?;
        Document::new(SceneFile::default()).context("a new scene")?
    };
    // Unit and gauge of the scene, without its present scan.
    let of_scene = SceneFile { site: None, ..document.value().clone() };
    shot.set_scene(Arc::new(scene::load_file(&of_scene, &args.scene, shot.recording.up)?));
    Ok((shot, document))
}

/// The pose by the pairs; without pairs that of the scene file, or the axes of the world.
fn scan_pose(
    args: &Args,
    shot: &Shot,
    scan: &SiteScan,
    present: Option<&SiteTable>,
    out: &mut impl Write,
) -> Result<ScanPlacement> {
    if args.pairs.is_empty() {
        if args.find_scale {
            bail!("--find-scale needs four pairs (--pair FRAME:X,Y=X,Y,Z)");
        }
        let present = present.and_then(SiteTable::world_from_scan);
        let text = if present.is_some() { "the scene's present place" } else { "the axes of the world" };
        writeln!(out, "aligned    by {text}: no pairs")?;
        return Ok(ScanPlacement {
            world_from_scan: present.unwrap_or(Pose::IDENTITY),
            unit_factor: None,
            prior: PosePrior::UNPAIRED,
        });
    }
    let frames = shot.recording.frame_count();
    if let Some(beyond) = args.pairs.iter().find(|pair| pair.view.frame >= frames) {
        bail!("--pair {}: the recording has {}", of_view(&beyond.view), count(frames, "frame"));
    }
    let by_pairs = shot.site_by_pairs(scan, &args.pairs, args.find_scale)?;
    for (pair, px) in args.pairs.iter().zip(&by_pairs.alignment.errors_px) {
        let point = pair.point.to_array().map(number).join(",");
        writeln!(out, "pair       {} = {point}: {px:.1} px off", of_view(&pair.view))?;
    }
    writeln!(out, "aligned    {by_pairs}")?;
    let SiteByPairs { world_from_scan, unit_factor, prior, .. } = by_pairs;
    Ok(ScanPlacement { world_from_scan, unit_factor, prior })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_parsed() {
        let pair = parse_pair("40:210.5,330=-1.25,0.31,0.02").unwrap();
        assert_eq!((pair.view.frame, pair.view.at_px.to_array()), (40, [210.5, 330.0]));
        assert_eq!(pair.point.to_array(), [-1.25, 0.31, 0.02]);
        for wrong in ["", "40:1,2", "40:1,2=1,2", "1,2=1,2,3", "x:1,2=1,2,3", "4:1,2=1,2,nan"] {
            assert!(parse_pair(wrong).unwrap_err().contains("expected"), "{wrong}");
        }
    }
}
