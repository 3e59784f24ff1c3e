//! A shot that changes between pictures: each picture equals that of a shot opened anew.

use std::path::Path;
use std::sync::Arc;

use crate::gpu;
use crate::program;
use crate::reduced::Reduction;
use crate::shot;
use crate::tier::{fast_or_full, is_full};
use glam::{DAffine3, DVec2, DVec3};
use locard::compositor::{Composited, Compositor, FrameStats, Target};
use locard::export::{Export, ExportError, Inputs};
use locard::gpu::Gpu;
use locard::photo::{Bracket, PhotoError, PhotoEvent, PhotoRequest, TakeError};
use locard::pixels::Pixels;
use locard::recording::OpenOptions;
use locard::scene::Scene;
use locard::shot::{Note, PartialExposure, ReducedFrame, Shot, ShotError, ShotOptions};
use locard::sink::OutPath;

const SCENE: &str = "scenes/demo.toml";

fn opened(sets: &[&str]) -> Result<Shot, ShotError> {
    opened_in(Path::new("recordings/demo"), sets)
}

fn opened_in(recording: &Path, sets: &[&str]) -> Result<Shot, ShotError> {
    let sets = sets.iter().map(ToString::to_string).collect();
    let options = ShotOptions { sets, scene: Some(SCENE.into()), ..ShotOptions::default() };
    Shot::open(recording, &OpenOptions::default(), &options)
}

/// The demonstration; in the fast tier at a quarter of its resolution, with only its two markers.
fn demo(sets: &[&str]) -> Shot {
    if is_full() {
        return opened(sets).unwrap();
    }
    let mut shot = opened_in(&Reduction::by(4).demo(), sets).unwrap();
    Arc::make_mut(&mut shot.scene).objects.retain(|object| object.name.starts_with("marker"));
    shot
}

fn picture(shot: &mut Shot, compositor: &mut Compositor, frame: usize) -> Composited {
    let pending = shot.picture(compositor, frame, Target::Pixels).unwrap();
    compositor.collect(pending).unwrap()
}

#[test]
fn settings_changed_between_pictures_take_effect() {
    let gpu = gpu::gpu();
    let shadows = fast_or_full(&["shadow.cast=false"][..], &[]);
    let mut shot = demo(shadows);
    let mut compositor = shot.compositor(gpu.clone());
    let mut pictures = vec![picture(&mut shot, &mut compositor, 31)];
    // Parameters of an effect, of the camera's lens and of its geometry.
    let sets = [
        "motion_blur.method=copies",
        "camera.lens.f_number=1.4",
        "camera.lens.focus_distance_m=0.8",
        fast_or_full("camera.fx_px=135", "camera.fx_px=540"),
    ];
    for count in 1..=sets.len() {
        shot.rig.set_text(sets[count - 1], &mut shot.settings).unwrap();
        let changed = picture(&mut shot, &mut compositor, 31);
        let mut anew = demo(&[shadows, &sets[..count]].concat());
        let expected = picture(&mut anew, &mut shot.compositor(gpu.clone()), 31);
        assert!(changed.pixels == expected.pixels, "{}", sets[count - 1]);
        pictures.push(changed);
    }
    let pixels = |n: usize| &pictures[n].pixels;
    assert!((1..pictures.len()).all(|n| pixels(n - 1) != pixels(n)), "each of them is seen");
    // The cached frame is unmodified, and another frame differs.
    assert!(*shot.read(31).unwrap().pixels != *pixels(4));
    let other = picture(&mut shot, &mut compositor, 30);
    assert!(other.frame == 30 && picture(&mut shot, &mut compositor, 31).pixels == *pixels(4));
}

#[test]
fn scene_changes_need_no_new_pipelines() {
    // Own device: the test counts its pipelines.
    let gpu = Gpu::open().unwrap();
    let mut shot = demo(&[]);
    let mut compositor = shot.compositor(gpu.clone());
    let before = picture(&mut shot, &mut compositor, 31);
    let made = gpu.pipeline_count();
    // The first is 2 cm higher, the second has no parts left.
    let up = DAffine3::from_translation(0.02 * DVec3::Z);
    let scene = Arc::make_mut(&mut shot.scene);
    scene.objects[0].parts.iter_mut().for_each(|part| part.world_from_mesh = up * part.world_from_mesh);
    scene.objects[1].parts.clear();
    let moved = picture(&mut shot, &mut compositor, 31);
    assert_eq!(gpu.pipeline_count(), made);
    let mut new = shot.compositor(gpu.clone());
    let anew = picture(&mut shot, &mut new, 31);
    assert!(moved.pixels != before.pixels && moved.pixels == anew.pixels);

    let made = gpu.pipeline_count();
    shot.scene = demo(&[]).scene;
    compositor.set_scene(Scene::clone(&shot.scene));
    assert!(picture(&mut shot, &mut compositor, 31).pixels == before.pixels);
    assert_eq!(gpu.pipeline_count(), made);
}

#[test]
fn stream_matches_frames_composited_alone() {
    let gpu = gpu::gpu();
    let mut shot = demo(&[]);
    let streams = [1, 2, 3].map(|in_flight| -> Vec<Composited> {
        let mut compositor = shot.compositor(gpu.clone());
        shot.frames(&mut compositor, 40..44, false, in_flight).unwrap().map(Result::unwrap).collect()
    });
    let mut compositor = shot.compositor(gpu.clone());
    for (n, frame) in (40..44).enumerate() {
        let alone = picture(&mut shot, &mut compositor, frame);
        for stream in &streams {
            assert!(stream.len() == 4 && stream[n].frame == frame && stream[n].stats == alone.stats);
            assert!(stream[n].pixels == alone.pixels, "frame {frame}");
        }
        assert!(alone.pixels != *shot.read(frame).unwrap().pixels);
    }
    let mut backwards = shot.compositor(gpu.clone());
    assert!(shot.frames(&mut backwards, 70..73, false, 2).is_err(), "there are 72");
}

#[test]
fn export_matches_the_shot_and_can_be_cancelled() {
    let temp = tempfile::tempdir().unwrap();
    let names = |folder: &Path| {
        let entries = std::fs::read_dir(folder).unwrap();
        let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    };
    let mut shot = demo(&[]);
    let mut compositor = shot.compositor(gpu::gpu().clone());
    let folder = temp.path().join("frames");
    let export = Export::new(31..34, OutPath::parse(&folder).unwrap());
    export.check(&Inputs::of(&shot)).unwrap();
    let mut frames = Vec::new();
    let done = export.run(&shot, &mut compositor, |stats| {
        frames.push(stats.frame);
        true
    });
    assert_eq!((done.unwrap().frames(), frames), (3, vec![31, 32, 33]));
    assert_eq!(names(&folder), ["frame_000031.png", "frame_000032.png", "frame_000033.png"]);
    let written = image::open(folder.join("frame_000032.png")).unwrap().to_rgb8();
    let shown = picture(&mut shot, &mut compositor, 32).pixels;
    assert!(written.as_raw() == shown.codes.eight_bit().unwrap());
    assert!(export.check(&Inputs::of(&shot)).is_err(), "what is there is kept");

    // A cancelled folder keeps its finished pictures; a cancelled video keeps nothing, nor the
    // folders made for it.
    let half = temp.path().join("half");
    let export = Export::new(31..40, OutPath::parse(&half).unwrap());
    let mut left = 2;
    let ended = export.run(&shot, &mut compositor, |_| {
        left -= 1;
        left > 0
    });
    assert!(matches!(ended, Err(ExportError::Cancelled)));
    assert_eq!(names(&half), ["frame_000031.png"]);
    let video = temp.path().join("new/cut.mkv");
    let export = Export::new(31..40, OutPath::parse(&video).unwrap());
    assert!(matches!(export.run(&shot, &mut compositor, |_| false), Err(ExportError::Cancelled)));
    assert_eq!(names(temp.path()), ["frames", "frames.record.json", "half"]);
}

// Slow: takes four photographs of the demonstration.
#[test]
fn photo_can_be_cancelled() {
    let temp = tempfile::tempdir().unwrap();
    let mut request = PhotoRequest::new(31, temp.path().join("a.jpg"));
    (request.lux, request.width_px) = (Some(300.0), Some(320));
    let device = || Ok(gpu::gpu().clone());
    let ended = request.take(demo(&[]), device, &mut |event| !matches!(event, PhotoEvent::Taking { .. }));
    assert!(matches!(ended, Err(PhotoError::Take(TakeError::Cancelled))), "{ended:?}");
    assert_eq!(std::fs::read_dir(temp.path()).unwrap().count(), 0);
    let mut written = Vec::new();
    let taken = request.take(demo(&[]), device, &mut |event| {
        if let PhotoEvent::Written { path, .. } = event {
            written.push(path);
        }
        true
    });
    taken.unwrap();
    assert_eq!(written, [request.output.clone()]);
    assert!(image::open(&written[0]).unwrap().width() == 320);

    // Cancelled by a warning before a device is opened, and between two of a series, the first of
    // which stays.
    let dark = PhotoRequest { lux: None, output: temp.path().join("dark.jpg"), ..request.clone() };
    let ended =
        dark.take(demo(&[]), || panic!("none is needed"), &mut |event| !matches!(event, PhotoEvent::Warning(_)));
    assert!(matches!(ended, Err(PhotoError::Take(TakeError::Cancelled))), "{ended:?}");
    let series =
        PhotoRequest { bracket: Some(Bracket::Iso), width_px: Some(64), output: temp.path().join("s.jpg"), ..request };
    let mut photographs = Vec::new();
    let ended = series.take(demo(&[]), device, &mut |event| match event {
        PhotoEvent::Taking { number, .. } => {
            photographs.push(number);
            true
        }
        event => !matches!(event, PhotoEvent::Written { .. }),
    });
    assert!(matches!(ended, Err(PhotoError::Take(TakeError::Cancelled))), "{ended:?}");
    assert!(photographs.iter().all(|number| *number == 1), "{photographs:?}");
    let names = |name: &str| temp.path().join(name).exists();
    assert!(names("s-1.jpg") && !names("s-2.jpg") && !names("s-sheet.jpg"));
}

#[test]
fn damaged_frame_ends_the_stream_and_names_its_file() {
    let temp = tempfile::tempdir().unwrap();
    program::with_a_truncated_frame(temp.path());
    let options = ShotOptions { profile: Some("profiles/simulated.toml".into()), ..ShotOptions::default() };
    let shot = Shot::open(temp.path(), &OpenOptions::default(), &options).unwrap();
    shot.check(0..6).unwrap();
    let mut compositor = shot.compositor(gpu::gpu().clone());
    let all: Vec<_> = shot.frames(&mut compositor, 0..6, false, 1).unwrap().collect();
    assert_eq!(all.len(), 4, "three frames, and what is wrong");
    // Without a scene the footage is unmodified.
    for (n, done) in all[..3].iter().enumerate() {
        assert!(done.as_ref().unwrap().pixels == *shot.read(n).unwrap().pixels);
    }
    let text = all[3].as_ref().unwrap_err().to_string();
    assert!(text.contains("00003.jpg"), "{text}");
}

#[test]
fn errors_name_the_accepted_values() {
    let error = |sets: &[&str]| match opened(sets).and_then(|shot| shot.check(0..72)) {
        Ok(()) => panic!("{sets:?} is accepted"),
        Err(error) => error.to_string(),
    };
    for (set, named) in [
        ("noise.scale=99", "0 to 8"),
        ("nosie.scale=1", "there is no table nosie"),
        ("camera.width_px=320", "the camera's picture is 320x480 px, the recording's frames are 640x480"),
        ("camera.lens.blades=2", "camera.lens.blades"),
    ] {
        assert!(error(&[set]).contains(named), "{}", error(&[set]));
    }
    let at = |recording: &str, scene: &str| {
        let options = ShotOptions { scene: Some(scene.into()), ..ShotOptions::default() };
        Shot::open(Path::new(recording), &OpenOptions::default(), &options).unwrap_err().to_string()
    };
    assert!(at("recordings/nothing", SCENE).contains("recordings/nothing: not a recording"));
    assert!(at("recordings/demo", "scenes/nothing.toml").contains("scenes/nothing.toml: cannot be read"));
    let temp = tempfile::tempdir().unwrap();
    program::with_a_truncated_frame(temp.path());
    let bare = Shot::open(temp.path(), &OpenOptions::default(), &ShotOptions::default()).unwrap();
    assert!(matches!(bare.check(0..1), Err(ShotError::NoCamera { .. })));
    assert!(matches!(shot::demo(SCENE).read(72), Err(ShotError::Recording(_))));
    assert!(matches!(shot::demo(SCENE).read(usize::MAX), Err(ShotError::Recording(_))));
}

#[test]
fn notes_follow_the_settings() {
    let temp = tempfile::tempdir().unwrap();
    program::with_a_truncated_frame(temp.path());
    std::fs::write(temp.path().join("poses.txt"), "0 0 0 0 0 0 0 1\n0.11 0 0 0 0 0 0 1\n").unwrap();
    let mut shot = Shot::open(temp.path(), &OpenOptions::default(), &ShotOptions::default()).unwrap();
    let notes = |shot: &Shot| shot.notes(0..6);
    let unknown = Note::UnknownExposure { has_times: true };
    assert!(matches!(&notes(&shot)[..], [Note::MissingPoses(text), exposure, Note::UnknownNoise]
        if text.contains("no pose for 2 of 6 frames") && *exposure == unknown));
    shot.rig.set_text("camera.exposure.time_s=0.01", &mut shot.settings).unwrap();
    assert!(matches!(&notes(&shot)[..], [Note::MissingPoses(_), Note::UnknownNoise]));
    assert_eq!(shot.notes(0..4), [Note::UnknownNoise]);
    // Effects that are off produce no notes.
    shot.settings.plain();
    assert_eq!(shot.notes(0..4), []);
    let stats = |frame, no_occlusion: Option<&str>| FrameStats {
        frame,
        timestamp_s: 0.0,
        no_pose: None,
        no_occlusion: no_occlusion.map(str::to_owned),
        no_example_noise: None,
        example_mismatch: None,
        rect_px: None,
        objects_in_sight: no_occlusion.is_some(),
        opacity: None,
        exposure_time_s: 0.0,
        fastest_px_per_s: 0.0,
        effects: Vec::new(),
    };
    assert_eq!(Note::of_frames(&[stats(0, None), stats(1, None)]), [Note::NothingSeen]);
    let [note] = &Note::of_frames(&[stats(0, None), stats(1, Some("why")), stats(2, Some("else"))])[..] else {
        panic!()
    };
    assert!(note.to_string().contains("2 of 3 frames") && note.to_string().contains("(frame 1: why)"), "{note}");
    let refused = FrameStats { no_example_noise: Some("another".to_owned()), ..stats(5, None) };
    let [note, Note::NothingSeen] = &Note::of_frames(&[stats(4, None), refused])[..] else { panic!() };
    assert!(note.to_string().contains("1 of 2 frames") && note.to_string().contains("(frame 5: another"), "{note}");
    // One note for all frames.
    let mismatch = |frame| FrameStats { example_mismatch: Some("it is small".to_owned()), ..stats(frame, None) };
    let [note @ Note::OtherNoise(_), Note::NothingSeen] = &Note::of_frames(&[mismatch(4), mismatch(5)])[..] else {
        panic!()
    };
    assert!(note.to_string().starts_with("it is small: another camera or setting?"), "{note}");
}

#[test]
fn command_line_values_override_profiles() {
    let taken = |sets: &[&str]| opened(sets).unwrap().exposure_settings(0);
    let by_profile = taken(&[]);
    let typed = PartialExposure { iso: Some(1234.0), ..by_profile };
    assert!(by_profile.iso != typed.iso && taken(&["camera.exposure.iso=1234"]) == typed);
    // An exposure time of zero is unusable for metering.
    assert_eq!(taken(&["camera.exposure.time_s=0"]), by_profile);
}

#[test]
fn outline_matches_the_drawn_border_and_its_inside_is_hit() {
    let gpu = gpu::gpu();
    // Sharp, so that coverage is that of the objects. The camera turns, has a rolling shutter, and
    // its lens distorts.
    let mut shot = opened(&["camera.exposure.time_s=0"]).unwrap();
    shot.settings.plain();
    let frame = 31;
    let geometry = shot.geometry_at(frame).unwrap();
    let mut compositor = shot.compositor(gpu.clone());
    let pending = shot.submit(&mut compositor, shot.read(frame).unwrap(), &geometry, Target::Pixels, true).unwrap();
    let layer = compositor.collect(pending).unwrap().layer.unwrap();
    let projected = shot.projected_objects(frame).unwrap();
    assert!(projected.iter().filter(|object| !object.outline_px.is_empty()).count() > 2, "{projected:?}");
    let eye = shot.posed_camera(frame).unwrap();
    let inside = |at: DVec2| {
        let winding = |polygon: &Vec<DVec2>| {
            let sides = polygon.iter().zip(polygon.iter().cycle().skip(1));
            sides
                .filter(|(a, b)| {
                    (a.y <= at.y) != (b.y <= at.y) && at.x < a.x + (at.y - a.y) / (b.y - a.y) * (b.x - a.x)
                })
                .count()
        };
        projected.iter().any(|object| object.outline_px.iter().map(winding).sum::<usize>() % 2 == 1)
    };
    let (mut covered, mut wrong, mut missed) = (0, 0, 0);
    for (x, y) in (0..480u32).flat_map(|y| (0..640u32).map(move |x| (x, y))) {
        let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let alpha = layer.rgba[(y * 640 + x) as usize][3];
        covered += u32::from(alpha > 0.5);
        wrong += u32::from((alpha > 0.5) != inside(at));
        // A subset: each ray is tested against every triangle.
        missed += u32::from((x + y) % 7 == 0 && alpha > 0.99 && eye.object_at(&shot.scene, at).is_none());
    }
    // A border pixel is tolerated: the outline is half a cell wide there.
    assert!(covered > 3000 && wrong * 20 < covered && missed * 3500 < covered, "{covered}: {wrong}, {missed}");
}

/// Means of blocks of 2×2 px.
fn halved(pixels: &Pixels) -> Vec<f64> {
    let (width, height) = (pixels.width / 2, pixels.height / 2);
    let places = (0..height).flat_map(|y| (0..width).flat_map(move |x| (0..3).map(move |c| (x, y, c))));
    let mean = |(x, y, c): (u32, u32, usize)| {
        let at = |right, down| f64::from(pixels.at(2 * x + right, 2 * y + down)[c]);
        (at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1)) / 4.0
    };
    places.map(mean).collect()
}

#[test]
fn half_size_picture_matches_the_reduced_full_size_one() {
    let mut shot = shot::demo(SCENE);
    let mut compositor = shot.compositor(gpu::gpu().clone());
    let frame = shot.read(31).unwrap();
    let reduced = ReducedFrame::new(&frame, 2);
    let half = |shot: &Shot, compositor: &mut Compositor| {
        let pending = shot.submit_reduced(compositor, &reduced, Target::Pixels).unwrap();
        compositor.collect(pending).unwrap()
    };
    let on_evidence = fast_or_full("shadow.on_evidence=false", "shadow.on_evidence=true");
    let sets = ["camera.lens.f_number=2", "camera.lens.focus_distance_m=0.5", "noise.scale=0", on_evidence];
    sets.iter().for_each(|set| shot.rig.set_text(set, &mut shot.settings).unwrap());
    let whole = picture(&mut shot, &mut compositor, 31);
    let plain = half(&shot, &mut compositor);
    let (width, height) = (plain.pixels.width, plain.pixels.height);
    assert_eq!((width, height), (whole.pixels.width / 2, whole.pixels.height / 2));
    let (camera, codes) = (halved(&frame.pixels), plain.pixels.codes.eight_bit().unwrap());
    let off: Vec<f64> = halved(&whole.pixels)
        .into_iter()
        .zip(codes)
        .zip(&camera)
        .filter(|((expected, _), camera)| (*expected - *camera).abs() > 3.0)
        .map(|((expected, code), _)| (expected - f64::from(*code)).abs())
        .collect();
    // Blur and motion in px are halved too. The rest is at edges, and between the mean of light and
    // the mean of codes.
    let mean = off.iter().sum::<f64>() / off.len() as f64;
    assert!(off.len() > 2000 && mean < 2.5, "{} values are off by {mean:.2}", off.len());

    // Noise of a mean of four.
    shot.rig.set_text("noise.scale=1", &mut shot.settings).unwrap();
    let grain = |noisy: Vec<f64>, plain: Vec<f64>| {
        let off =
            noisy.into_iter().zip(plain).zip(&camera).filter(|((_, plain), camera)| (plain - *camera).abs() > 3.0);
        let (sum, count) = off.fold((0.0, 0), |(sum, n), ((noisy, plain), _)| (sum + (noisy - plain).powi(2), n + 1));
        f64::sqrt(sum / f64::from(count))
    };
    let noisy_whole = picture(&mut shot, &mut compositor, 31);
    let noisy = half(&shot, &mut compositor);
    let codes = |of: &Composited| of.pixels.codes.eight_bit().unwrap().iter().copied().map(f64::from).collect();
    let (of_half, of_whole) =
        (grain(codes(&noisy), codes(&plain)), grain(halved(&noisy_whole.pixels), halved(&whole.pixels)));
    assert!((of_half / of_whole - 1.0).abs() < 0.15, "σ {of_half:.3} and {of_whole:.3}");
}

#[test]
fn gpu_timings_cover_each_pass() {
    let shot = demo(&[]);
    let gpu = gpu::gpu();
    let mut compositor = shot.compositor(gpu.clone());
    let pending = shot.picture(&mut compositor, 31, Target::Pixels).unwrap();
    assert_eq!(pending.times(&gpu).unwrap(), [], "nobody asked");
    let first = compositor.collect(pending).unwrap();
    compositor.time_next();
    let pending = shot.picture(&mut compositor, 31, Target::Pixels).unwrap();
    let times = pending.times(&gpu).unwrap();
    let parts: Vec<_> = times.iter().map(|of| of.part).collect();
    assert!(compositor.collect(pending).unwrap().pixels == first.pixels);
    if gpu.timestamps {
        assert!(["objects", "motion_blur", "mix"].iter().all(|part| parts.contains(part)), "{parts:?}");
        let sum_s: f64 = times.iter().map(|of| of.time_s).sum();
        assert!(sum_s > 0.0 && times.iter().all(|of| of.time_s >= 0.0), "{times:?}");
    } else {
        assert_eq!(times, []);
    }
}
