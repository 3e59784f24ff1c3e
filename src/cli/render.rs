//! `locard render`.

use std::path::PathBuf;

use anyhow::{Result, bail};
use glam::{DVec2, DVec3};

use super::labels::LabelArgs;
use super::{print_status, warn};
use locard_engine::camera::curved::{CurvedCamera, CurvedProjection};
use locard_engine::camera::{Distortion, Geometry, Intrinsics, Response};
use locard_engine::export::Inputs;
use locard_engine::gpu::Gpu;
use locard_engine::label::{DigitalSourceType, SourceLabel};
use locard_engine::pose::Pose;
use locard_engine::render::{PictureRequest, Projection, Renderer, limits, take_still};
use locard_engine::scene::{Environment, Scene};
use locard_engine::sink::picture;
use locard_engine::text::short;

#[derive(clap::Args)]
pub struct Args {
    /// A .glb or .gltf, or a scene.toml
    scene: PathBuf,
    /// Projection of directions into the picture
    #[arg(long, value_enum, default_value_t = RenderProjection::Perspective)]
    camera: RenderProjection,
    /// Width and height in pixels; by default 1024x768, 1024x1024 for a circle, 2048x1024 for an
    /// environment
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<(u32, u32)>,
    /// Angle of view in degrees: vertical (perspective, off-centre; 45), across the circle that
    /// touches the nearer sides (fisheye; 180, little-planet; 250), horizontal and, after a comma,
    /// vertical (environment; 360,180)
    #[arg(long, value_name = "DEG[,DEG]", value_parser = angles, allow_hyphen_values = true)]
    fov: Option<(f64, Option<f64>)>,
    /// Height of the view in metres (orthographic); by default the whole scene
    #[arg(long, value_name = "M", value_parser = metres, allow_hyphen_values = true)]
    height: Option<f64>,
    /// Shift of the picture to the right of the axis and above it, in picture widths and heights
    /// (off-centre)
    #[arg(long, value_name = "X,Y", value_parser = vector::<2>, allow_hyphen_values = true)]
    shift: Option<[f64; 2]>,
    /// Position of the camera, in metres; by default one that shows the scene
    #[arg(long, value_name = "X,Y,Z", value_parser = vector::<3>, allow_hyphen_values = true)]
    from: Option<[f64; 3]>,
    /// The point that it faces; by default the scene's middle
    #[arg(long, value_name = "X,Y,Z", value_parser = vector::<3>, allow_hyphen_values = true)]
    at: Option<[f64; 3]>,
    /// The direction up in the picture; by default the scene's up
    #[arg(long, value_name = "X,Y,Z", value_parser = vector::<3>, allow_hyphen_values = true)]
    up: Option<[f64; 3]>,
    /// Omit the picture of the environment, so that there is nothing behind the objects (parallel
    /// rays omit it anyway)
    #[arg(long)]
    transparent: bool,
    /// A .png, or a .exr in linear light
    #[arg(short = 'o', long = "output", value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    labels: LabelArgs,
    /// Replace a picture that exists
    #[arg(long)]
    force: bool,
    /// No warnings
    #[arg(long, short)]
    quiet: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum RenderProjection {
    /// A pinhole
    Perspective,
    /// Parallel rays
    Orthographic,
    /// A pinhole with the picture shifted off its axis
    OffCentre,
    /// Equal angles are equal distances
    Fisheye,
    /// Longitude and latitude, all around
    Environment,
    /// Stereographic, looking down
    LittlePlanet,
}

impl RenderProjection {
    fn is_equirectangular(self) -> bool {
        matches!(self, Self::Fisheye | Self::LittlePlanet)
    }

    fn default_fov_deg(self) -> f64 {
        match self {
            Self::Perspective | Self::OffCentre | Self::Orthographic => 45.0,
            Self::Fisheye => 180.0,
            Self::LittlePlanet => 250.0,
            Self::Environment => 360.0,
        }
    }

    /// The largest accepted angle.
    fn largest_fov_deg(self) -> f64 {
        match self {
            Self::Perspective | Self::OffCentre | Self::Orthographic => 175.0,
            Self::LittlePlanet => 355.0,
            Self::Fisheye | Self::Environment => 360.0,
        }
    }
}

fn size(text: &str) -> Result<(u32, u32), String> {
    let side = |t: &str| t.parse().ok().filter(|n| (1..=16384).contains(n));
    let parsed = text.split_once(['x', 'X']).and_then(|(w, h)| Some((side(w)?, side(h)?)));
    parsed.ok_or_else(|| format!("{text} is not a size; expected WxH, each 1 to 16384, as in 1024x768"))
}

fn angles(text: &str) -> Result<(f64, Option<f64>), String> {
    let angle = |t: &str| t.trim().parse().ok().filter(|a| *a > 0.0 && *a <= 360.0);
    let parsed = match text.split_once(',') {
        Some((x, y)) => angle(x).zip(angle(y)).map(|(x, y)| (x, Some(y))),
        None => angle(text).map(|x| (x, None)),
    };
    parsed.ok_or_else(|| format!("{text} is not an angle of view; expected more than 0 and up to 360 (degrees)"))
}

fn metres(text: &str) -> Result<f64, String> {
    let parsed = text.trim().parse().ok().filter(|m| *m >= 1e-6 && *m <= 1e6);
    parsed.ok_or_else(|| "expected 0.000001 to 1000000 (m)".to_owned())
}

fn vector<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let parsed: Option<Vec<f64>> = text.split(',').map(|t| t.trim().parse().ok()).collect();
    let numbers: Option<[f64; N]> = parsed.and_then(|v| v.try_into().ok());
    let example = ["0.4", "-0.2", "1.5"][..N].join(",");
    let numbers =
        numbers.ok_or_else(|| format!("{text}: expected {N} numbers with commas between, as in {example}"))?;
    if numbers.iter().all(|v| v.abs() <= 1e9) {
        Ok(numbers)
    } else {
        Err(format!("{text}: expected numbers from -1000000000 to 1000000000"))
    }
}

pub fn run(args: &Args) -> Result<()> {
    check(args)?;
    let scene = locard_engine::scene::load(&args.scene, None)?;
    picture::check(&args.output, args.force)?;
    Inputs::default().and(&scene.files).check_file(&args.output)?;
    scene.warnings.iter().for_each(|text| warn(args.quiet, text));
    let sphere = bounding_sphere(&scene);
    let pose = pose(args, sphere, scene.up_in_world.unwrap_or(DVec3::Y))?;
    let projection = projection(args, sphere);
    if let Projection::Curved(curved) = &projection
        && let Some((needed_px, drawn)) = limits(curved)
    {
        let text = format!("the picture's finest part needs cube faces of {needed_px} px; they are drawn with {drawn}");
        warn(args.quiet, &text);
    }
    let has_picture = matches!(scene.lighting.environment, Environment::Map(_));
    let background = has_picture && !args.transparent && args.camera != RenderProjection::Orthographic;
    let still = PictureRequest { projection, pose, background };
    let gpu = Gpu::open()?;
    let mut renderer = Renderer::new(&gpu, scene);
    renderer.warnings().iter().for_each(|text| warn(args.quiet, text));
    let image = take_still(&gpu, &mut renderer, &still)?;
    if !still.background && image.rgba.iter().all(|p| p[3] == 0.0) {
        warn(args.quiet, "nothing of the scene is in the picture: see --from, --at and --fov");
    }
    args.labels.warn(DigitalSourceType::DigitalCreation, []);
    let label = args.labels.is_labelled().then(SourceLabel::rendering);
    picture::write(&args.output, &image, &Response::default(), label.as_ref(), args.force)?;
    let eye = pose.position_in_world_m().to_array().map(short).join(",");
    print_status(args.quiet, &format!("{}x{} px, from {eye}: {}", image.width, image.height, args.output.display()));
    Ok(())
}

/// Checks that the given options belong to the camera.
fn check(args: &Args) -> Result<()> {
    let kind = args.camera;
    if let Some((fov, second)) = args.fov {
        let largest = kind.largest_fov_deg();
        if kind == RenderProjection::Orthographic {
            bail!("--fov: parallel rays have no angle of view; --height sets the height of the view, in metres");
        }
        if second.is_some() && kind != RenderProjection::Environment {
            bail!("--fov: this camera has one angle of view; two are for --camera environment");
        }
        if fov > largest || second.is_some_and(|fov| fov > 180.0) {
            let also = if kind == RenderProjection::Environment { " by 180" } else { "" };
            bail!("--fov {}: expected up to {largest}{also} degrees for this camera", short(second.unwrap_or(fov)));
        }
    }
    if args.height.is_some() && kind != RenderProjection::Orthographic {
        bail!("--height is for --camera orthographic; this camera has an angle of view, --fov");
    }
    match (args.shift, kind) {
        (None, RenderProjection::OffCentre) => bail!("--camera off-centre needs --shift X,Y, as in --shift 0,0.25"),
        (Some(_), kind) if kind != RenderProjection::OffCentre => bail!("--shift is for --camera off-centre"),
        (Some(shift), _) if shift.iter().any(|s| s.abs() > 10.0) => bail!("--shift: expected -10 to 10"),
        _ => Ok(()),
    }
}

/// Bounding sphere of the scene's vertices: centre and radius, m. A metre at the origin if there
/// are none.
fn bounding_sphere(scene: &Scene) -> (DVec3, f64) {
    let points = || {
        scene.objects.iter().flat_map(|o| &o.parts).flat_map(|part| {
            let vertices = scene.meshes[part.mesh].vertices.iter();
            vertices.map(|v| part.world_from_mesh.transform_point3(DVec3::from(v.position.map(f64::from))))
        })
    };
    let box_around = points().map(|p| (p, p)).reduce(|(low, high), (p, _)| (low.min(p), high.max(p)));
    let Some((low, high)) = box_around else { return (DVec3::ZERO, 1.0) };
    let middle = 0.5 * (low + high);
    (middle, points().map(|p| p.distance(middle)).fold(1e-3, f64::max))
}

/// The pose of the camera. By default it is in front of the scene, to one side and above, at a
/// distance from which all of the scene is visible. An environment's is above the centre and faces
/// ahead, a little planet's faces down from there.
fn pose(args: &Args, (middle, radius): (DVec3, f64), scene_up: DVec3) -> Result<Pose> {
    let given_up = args.up.map(DVec3::from);
    let up = given_up.unwrap_or(scene_up).normalize_or_zero();
    // Perpendicular to up: the axis least aligned with it, projected.
    let aside = [DVec3::X, DVec3::Y, DVec3::Z]
        .into_iter()
        .reduce(|best, axis| if axis.dot(up).abs() < best.dot(up).abs() { axis } else { best })
        .unwrap_or(DVec3::X)
        .reject_from(if up == DVec3::ZERO { DVec3::Z } else { up })
        .normalize_or(DVec3::X);
    let ahead = up.cross(aside);
    let target = args.at.map(DVec3::from);
    let eye = args.from.map(DVec3::from).unwrap_or_else(|| {
        let at = target.unwrap_or(middle);
        match args.camera {
            RenderProjection::Environment | RenderProjection::LittlePlanet => at + radius * up,
            kind => {
                // Half of the field of view across the smaller side. The sphere fills nine tenths
                // of it.
                let fov = args.fov.map_or(kind.default_fov_deg(), |fov| fov.0).to_radians();
                let (w, h) = picture_size(args);
                let narrow = (f64::from(w) / f64::from(h)).min(1.0);
                let half = if kind.is_equirectangular() { 0.5 * fov } else { (narrow * (0.5 * fov).tan()).atan() };
                let half = (0.9 * half).min(55f64.to_radians());
                let towards = (0.5 * aside - ahead + 0.6 * up).normalize_or(-ahead);
                at + towards * (radius / half.sin())
            }
        }
    });
    let target = target.unwrap_or(match args.camera {
        RenderProjection::Environment => eye + ahead,
        RenderProjection::LittlePlanet => eye - up,
        _ => middle,
    });
    // If the viewing direction is up and no other up was given, ahead becomes up.
    let along = (target - eye).normalize_or_zero().cross(up).length() < 1e-6;
    let up = if along && given_up.is_none() { ahead } else { up };
    let Some(pose) = Pose::look_at(eye, target, up) else {
        bail!(
            "--from {eye}, --at {target} and --up {up} do not define a view: the first two must differ, and the line \
             between them must not run along the third"
        );
    };
    Ok(pose)
}

fn picture_size(args: &Args) -> (u32, u32) {
    args.size.unwrap_or(match args.camera {
        RenderProjection::Environment => (2048, 1024),
        kind if kind.is_equirectangular() => (1024, 1024),
        _ => (1024, 768),
    })
}

fn projection(args: &Args, (_, radius): (DVec3, f64)) -> Projection {
    let (width_px, height_px) = picture_size(args);
    let size = DVec2::new(width_px.into(), height_px.into());
    let fov_rad = args.fov.map_or(args.camera.default_fov_deg(), |fov| fov.0).to_radians();
    let curved = |curve| Projection::Curved(CurvedCamera { curve, width_px, height_px });
    match args.camera {
        RenderProjection::Fisheye => curved(CurvedProjection::Fisheye { fov_rad }),
        RenderProjection::LittlePlanet => curved(CurvedProjection::LittlePlanet { fov_rad }),
        RenderProjection::Environment => {
            let vertical =
                args.fov.and_then(|fov| fov.1).map_or((0.5 * fov_rad).min(std::f64::consts::PI), f64::to_radians);
            curved(CurvedProjection::Environment { fov_rad: DVec2::new(fov_rad, vertical) })
        }
        RenderProjection::Orthographic => {
            // The bounding sphere with a margin of a tenth.
            let height_m = args.height.unwrap_or(2.2 * radius * (size.y / size.x).max(1.0));
            Projection::Orthographic { width_px, height_px, px_per_m: size.y / height_m }
        }
        RenderProjection::Perspective | RenderProjection::OffCentre => {
            let focal_px = 0.5 * size.y / (0.5 * fov_rad).tan();
            // With a window right of the axis, the axis is on its left; rows count downwards.
            let shift = args.shift.map_or(DVec2::ZERO, DVec2::from) * DVec2::new(-1.0, 1.0);
            let DVec2 { x: cx_px, y: cy_px } = size * (0.5 + shift);
            let intrinsics = Intrinsics {
                width_px,
                height_px,
                fx_px: focal_px,
                fy_px: focal_px,
                cx_px,
                cy_px,
                ..Intrinsics::default()
            };
            Projection::Perspective(Geometry::new(intrinsics, Distortion::default()))
        }
    }
}
