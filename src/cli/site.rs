//! `locard site`: puts a scan of the place into a scene, aligned with the recording.

use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use glam::DVec3;

use super::analysis::AnalysisArgs;
use super::pick::{numbers, of_view, view};
use super::warn;
use locard_engine::export::Inputs;
use locard_engine::pose::Pose;
use locard_engine::recording::{OpenOptions, Recording};
use locard_engine::scene::document::Up;
use locard_engine::scene::{self, Document, SceneFile, SiteTable};
use locard_engine::shot::{FramePoint, Shot, ShotOptions};
use locard_engine::sink::{self, atomic::write_atomically};
use locard_engine::site::alignment::{Alignment, AlignmentOptions, RayPair};
use locard_engine::site::refinement::{PosePrior, SiteRefinement};
use locard_engine::site::{ScannedSite, SiteScan};
use locard_engine::text::{count, fixed, number};

/// Assumed standard deviations of a pose that no pairs determine: of an alignment by hand.
const UNPAIRED: PosePrior = PosePrior { sigma_m: 0.03, sigma_rad: 0.02, center_m: None };

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
    #[arg(long = "pair", value_name = "FRAME:X,Y=X,Y,Z", value_parser = PickedPair::parse, allow_hyphen_values = true)]
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

/// A position in a frame, and the point of the scan there, in the scan's unit.
#[derive(Clone, Debug, PartialEq)]
struct PickedPair {
    view: FramePoint,
    point: DVec3,
}

impl PickedPair {
    fn parse(text: &str) -> Result<Self, String> {
        const EXPECTED: &str = "FRAME:X,Y=X,Y,Z, as in 40:210,330=1.25,0.31,0.02";
        let (of_frame, of_scan) = text.split_once('=').ok_or_else(|| format!("{text}: expected {EXPECTED}"))?;
        Ok(Self { view: view(of_frame, EXPECTED)?, point: numbers::<3>(of_scan, "1.25,0.31,0.02")?.into() })
    }
}

/// The pose of a scan, and its origin.
struct ScanPlacement {
    world_from_scan: Pose,
    /// Factor on the recording's unit.
    unit_factor: f64,
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
    if args.find_scale {
        set_scale(&mut shot, &mut file, placement.unit_factor, &mut out)?;
    }
    let mut site = ScannedSite::new(scan, placement.world_from_scan);
    if !args.no_refine {
        match shot.refined_site(&site, placement.prior)? {
            Ok(refined) => {
                writeln!(out, "refined    {}", refinement_text(&refined))?;
                site = refined.site;
            }
            Err(why) => writeln!(out, "refined    not: {why}")?,
        }
    }
    if shot.site_coverage(&site, 0..shot.recording.frame_count()).is_some_and(|covered| covered < 0.01) {
        writeln!(
            out,
            "odd        hardly any frame shows the scan: check the pairs, and its unit (--scan-unit 0.001 for millimetres)"
        )?;
    }
    let pose = site.world_from_scan;
    let posed = (0..shot.recording.frame_count()).find(|frame| shot.recording.pose_at_frame(*frame).is_ok());
    let gauge_frame = args.pairs.first().map(|pair| pair.view.frame).or(posed);
    file.site = Some(SiteTable {
        scan: scene::relative(&args.scan, &args.scene),
        metres_per_unit: args.scan_unit,
        position_m: Some(pose.translation_m.to_array()),
        quaternion: Some(pose.rotation.to_array()),
    });
    if file.gauge.is_none() {
        file.gauge = gauge_frame.and_then(|frame| shot.gauge(frame));
    }
    if let (None, None, Some(up)) = (file.up, shot.recording.up, site.scan.up) {
        let up = (pose.rotation * up).to_array();
        file.up = Some(Up::Direction(up));
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
            unit_factor: 1.0,
            prior: UNPAIRED,
        });
    }
    let frames = shot.recording.frame_count();
    let rays: Vec<RayPair> = args
        .pairs
        .iter()
        .map(|pair| {
            if pair.view.frame >= frames {
                bail!("--pair {}: the recording has {}", of_view(&pair.view), count(frames, "frame"));
            }
            Ok(shot.ray_pair(&pair.view, pair.point * scan.metres_per_unit)?)
        })
        .collect::<Result<_>>()?;
    let ups = scan.up.zip(shot.up()).map(|(scan, world)| [scan, world]);
    let alignment = Alignment::of_pairs(&rays, &AlignmentOptions { ups, finds_scale: args.find_scale })?;
    for (pair, px) in args.pairs.iter().zip(&alignment.errors_px) {
        let point = pair.point.to_array().map(number).join(",");
        writeln!(out, "pair       {} = {point}: {px:.1} px off", of_view(&pair.view))?;
    }
    let transform = alignment.world_from_scan;
    writeln!(
        out,
        "aligned    within {:.0} mm and {:.2}° (1 σ), by {}{}",
        1e3 * alignment.sigma_m,
        alignment.sigma_rad.to_degrees(),
        count(rays.len(), "pair"),
        if args.find_scale {
            format!("; the unit within {:.1} %", 100.0 * alignment.sigma_scale)
        } else {
            String::new()
        }
    )?;
    // Positions in the world grow with its unit.
    let world_from_scan = Pose::new(transform.rotation, transform.translation_m / transform.scale);
    let sigma_m = alignment.sigma_m / transform.scale;
    let center = rays.iter().map(|ray| ray.point_m).sum::<DVec3>() / rays.len() as f64;
    let center_m = Some(world_from_scan.transform_point(center));
    let prior = PosePrior { sigma_m: sigma_m.max(1e-3), sigma_rad: alignment.sigma_rad.max(1e-3), center_m };
    Ok(ScanPlacement { world_from_scan, unit_factor: transform.scale.recip(), prior })
}

/// Sets the length of the recording's unit in the shot and the scene file.
fn set_scale(shot: &mut Shot, file: &mut SceneFile, factor: f64, out: &mut impl Write) -> Result<()> {
    if shot.recording.kind.is_metric() {
        bail!("--find-scale: a {} recording is in metres", shot.recording.kind);
    }
    if !file.objects.is_empty() {
        bail!("--find-scale: the scene's objects were placed with another unit; use a new scene file");
    }
    let unit_m = factor * shot.recording.metres_per_unit;
    file.metres_per_unit = Some(unit_m);
    file.gauge = None;
    Arc::make_mut(&mut shot.recording).rescale(unit_m);
    writeln!(out, "unit       {} m, written into the scene file", number(unit_m))?;
    Ok(())
}

fn refinement_text(refined: &SiteRefinement) -> String {
    let [before, after] = refined.loss;
    format!(
        "by {}: moved by {:.0} mm and {:.2}°, differences fell by {:.0} %",
        count(refined.pixels, "pixel"),
        1e3 * refined.moved_m,
        refined.turned_rad.to_degrees(),
        100.0 * (1.0 - after / before)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_parsed() {
        let pair = PickedPair::parse("40:210.5,330=-1.25,0.31,0.02").unwrap();
        assert_eq!((pair.view.frame, pair.view.at_px.to_array()), (40, [210.5, 330.0]));
        assert_eq!(pair.point.to_array(), [-1.25, 0.31, 0.02]);
        for wrong in ["", "40:1,2", "40:1,2=1,2", "1,2=1,2,3", "x:1,2=1,2,3", "4:1,2=1,2,nan"] {
            assert!(PickedPair::parse(wrong).unwrap_err().contains("expected"), "{wrong}");
        }
    }
}
