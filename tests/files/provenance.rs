//! Labels, masks and records of outputs, and their audit.

use std::path::Path;
use std::process::Command;

use crate::program::{locard, refused, stdout_of};
use locard::provenance::{OutputKind, Record, file_digest, record_path};
use locard::source::still;
use serde_json::Value;

const SOURCE_TYPE: &str = "http://cv.iptc.org/newscodes/digitalsourcetype/compositeSynthetic";

/// `locard composite` of frames of the demonstration without shadows.
fn composite(frames: &str, output: &Path, more: &[&str]) {
    let output = output.to_str().unwrap();
    let arguments = ["composite", "recordings/demo", "--scene", "scenes/demo.toml", "--set", "shadow.cast=false"];
    let arguments = [&arguments[..], &["--frames", frames, "-q", "-o", output], more].concat();
    let done = locard(&arguments);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
}

/// Copies the demonstration's scene, with absolute paths. Returns the file's text.
fn copy_scene(file: &Path) -> String {
    let scenes = std::path::absolute("scenes").unwrap();
    let text = std::fs::read_to_string("scenes/demo.toml").unwrap();
    let text = text.replace("model = \"", &format!("model = \"{}/", scenes.display()));
    let text = text.replace("environment = \"", &format!("environment = \"{}/", scenes.display()));
    std::fs::write(file, &text).unwrap();
    text
}

/// The output of an audit that finds a difference.
fn found_by_audit(arguments: &[&str]) -> String {
    let done = locard(&[&["audit", "-q"], arguments].concat());
    assert_eq!(done.status.code(), Some(2), "{}", String::from_utf8_lossy(&done.stderr));
    String::from_utf8(done.stdout).unwrap()
}

/// Changes a record as JSON.
fn edit_record(output: &Path, change: impl FnOnce(&mut Value)) {
    let file = record_path(output);
    let mut value: Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    change(&mut value);
    std::fs::write(&file, value.to_string()).unwrap();
}

fn contains(file: &Path, text: &str) -> bool {
    std::fs::read(file).unwrap().windows(text.len()).any(|window| window == text.as_bytes())
}

/// ffprobe's metadata of a video, with its XMP.
fn metadata(video: &Path) -> String {
    let options =
        ["-v", "error", "-show_entries", "format_tags", "-export_xmp", "1", "-of", "default=noprint_wrappers=1"];
    let done = Command::new("ffprobe").args(options).arg(video).output().unwrap();
    String::from_utf8_lossy(&done.stdout).into_owned()
}

// Slow: seven runs of the program, one for each kind of file.
#[test]
fn every_output_is_labelled_unless_asked_otherwise() {
    let temp = tempfile::tempdir().unwrap();
    let at = |name: &str| temp.path().join(name);
    composite("40..41", &at("frames"), &["--layers", at("layers").to_str().unwrap()]);
    for file in ["frames/frame_000040.png", "layers/layer_000040.exr"] {
        assert!(contains(&at(file), SOURCE_TYPE) && contains(&at(file), "locard:frame=\"40\""), "{file}");
        assert!(contains(&at(file), "locard:recording=\"demo\""), "{file}");
    }
    for name in ["a.mp4", "a.mkv", "a.mov"] {
        composite("40..41", &at(name), &["--plain"]);
        assert!(metadata(&at(name)).contains("Composite with synthetic elements"), "{name}");
        assert!(contains(&at(name), SOURCE_TYPE), "{name}");
        assert!(contains(&at(name), "locard:frames=\"40..41\""), "{name}");
    }
    assert!(metadata(&at("a.mkv")).contains(&format!("DIGITAL_SOURCE_TYPE={SOURCE_TYPE}")));
    let photo = at("a.jpg");
    let arguments = ["photo", "recordings/demo", "--frame", "40", "--scene", "scenes/demo.toml", "--lux", "300"];
    let small = ["--set", "shadow.cast=false", "--width", "160", "-q", "-o", photo.to_str().unwrap()];
    let arguments = [&arguments[..], &small].concat();
    assert!(locard(&arguments).status.success());
    assert!(contains(&photo, SOURCE_TYPE));
    let rendering = at("a.png");
    let arguments = ["render", "scenes/marker-1.glb", "--size", "32x32", "-q", "-o", rendering.to_str().unwrap()];
    assert!(locard(&arguments).status.success());
    assert!(contains(&rendering, "digitalsourcetype/digitalCreation"));

    let bare = at("bare");
    let arguments =
        ["composite", "recordings/demo", "--scene", "scenes/demo.toml", "--frames", "40..41", "-q", "--plain"];
    let done = locard(&[&arguments[..], &["--unlabelled", "-o", bare.to_str().unwrap()]].concat());
    let text = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success() && text.contains("does not state its digital source type"), "{text}");
    assert!(!contains(&bare.join("frame_000040.png"), "compositeSynthetic"));
}

#[test]
fn mark_changes_the_corner_alone_and_masks_cover_all_other_changes() {
    let temp = tempfile::tempdir().unwrap();
    let at = |name: &str| temp.path().join(name);
    composite("40..41", &at("plain"), &["--masks", at("masks").to_str().unwrap()]);
    composite("40..41", &at("marked"), &["--mark"]);
    let read = |path: &str| image::open(at(path)).unwrap().to_rgb8();
    let (plain, marked) = (read("plain/frame_000040.png"), read("marked/frame_000040.png"));
    let footage = still::read_pixels(Path::new("recordings/demo/rgb/00040.jpg")).unwrap();
    let differing = plain.enumerate_pixels().zip(marked.pixels()).filter(|((.., a), b)| a != b);
    let rows: Vec<u32> = differing.map(|((_, y, _), _)| y).collect();
    // The plate is 0.045 of 480 rows high.
    assert!(rows.len() > 1000 && rows.iter().all(|y| *y >= 480 - 22), "{} {:?}", rows.len(), rows.iter().min());
    let record = Record::read(&at("plain")).unwrap();
    let picture = &record.pictures[0];
    let mask = picture.mask.as_ref().unwrap();
    let drawn = read("masks/mask_000040.png");
    let reds = drawn.pixels().filter(|pixel| pixel.0[0] == 255).count() as u64;
    assert_eq!(mask.synthetic.area_px(), reds);
    assert!(reds > 500, "{reds}");
    for ((x, y, composite), mask) in plain.enumerate_pixels().zip(drawn.pixels()) {
        assert!(footage.at(x, y) == composite.0.map(u32::from) || mask.0 != [0; 3], "{x}, {y}");
    }
}

#[test]
fn record_lists_inputs_settings_and_pictures() {
    let temp = tempfile::tempdir().unwrap();
    let output = temp.path().join("frames");
    composite("40..42", &output, &["--set", "noise.scale=1.5", "--seed", "7", "--without", "halation"]);
    let record = Record::read(&output).unwrap();
    assert_eq!((record.work.seed, record.range, record.output.kind), (7, [40, 42], OutputKind::Frames));
    assert_eq!(record.work.command.arguments[0], "composite");
    assert_eq!(record.work.settings.without, ["halation"]);
    let scale = serde_json::to_value(&record.work.settings.parameters["noise"]["scale"]).unwrap();
    assert_eq!(scale, Value::from(1.5));
    for (role, name) in [("recording", "recording.toml"), ("scene", "demo.toml"), ("scene", "marker-1.glb")] {
        let input = record.work.inputs.iter().find(|input| input.path.ends_with(name)).unwrap();
        assert_eq!(input.role, role, "{name}");
        let digest = file_digest(&input.path).unwrap();
        assert_eq!((input.bytes, &input.sha256), (digest.bytes, &digest.sha256), "{name}");
    }
    assert_eq!(record.pictures.iter().map(|picture| picture.frame).collect::<Vec<_>>(), [40, 41]);
    // Another range into the same folder is added.
    composite("42..43", &output, &["--set", "noise.scale=1.5", "--seed", "7", "--without", "halation", "--force"]);
    let joined = Record::read(&output).unwrap();
    assert_eq!((joined.range, joined.pictures.len()), ([40, 43], 3));
    assert_eq!(joined.pictures[..2], record.pictures);
    let bare = temp.path().join("bare");
    composite("40..41", &bare, &["--no-record"]);
    assert!(!record_path(&bare).exists());
}

#[test]
fn audit_passes_the_output_as_made_and_names_each_change() {
    let temp = tempfile::tempdir().unwrap();
    let at = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let text = copy_scene(Path::new(&at("scene.toml")));
    let (scene, output) = (at("scene.toml"), at("frames"));
    let arguments = ["composite", "recordings/demo", "--scene", &scene, "--frames", "40..43", "--mark", "Training"];
    let arguments = [&arguments[..], &["--set", "shadow.cast=false", "-q", "-o", &output]].concat();
    assert!(locard(&arguments).status.success());
    // The first and the last of three.
    let passed = stdout_of(&["audit", "-q", &output, "--sample", "2"]);
    assert!(passed.contains("frames: 2 of 2 recomputed are equal to the record bit for bit"), "{passed}");
    // The first marker is moved by a centimetre.
    std::fs::write(&scene, text.replacen("[0.0, 0.12, 0.0]", "[0.01, 0.12, 0.0]", 1)).unwrap();
    let listed = found_by_audit(&[&output, "--sample", "2"]);
    for part in ["scene.toml (scene): has changed", "frame 40: differs by up to ", "frame 42: differs by up to "] {
        assert!(listed.contains(part), "{part}: {listed}");
    }
    std::fs::write(&scene, &text).unwrap();
    // A picture retouched in one pixel.
    let file = Path::new(&output).join("frame_000041.png");
    let mut picture = image::open(&file).unwrap().to_rgb8();
    picture.get_pixel_mut(5, 7).0[1] ^= 1;
    picture.save(&file).unwrap();
    let listed = found_by_audit(&[&output, "--files-only"]);
    assert!(listed.contains("frame_000041.png (output): its pixels have changed since it was written"), "{listed}");
    // An edited record: first it contradicts itself, then the differences of the frames are listed.
    let mut record = Record::read(Path::new(&output)).unwrap();
    record.work.command.arguments.extend(["--seed".to_owned(), "3".to_owned()]);
    record.write(Path::new(&output)).unwrap();
    let error = refused(&["audit", "-q", &output, "--sample", "1"]);
    assert!(error.contains("another seed than the record states"), "{error}");
    record.work.seed = 3;
    record.pictures[0].rect_px = Some([1, 2, 30, 40]);
    record.write(Path::new(&output)).unwrap();
    let listed = found_by_audit(&[&output, "--sample", "1"]);
    assert!(listed.contains("frame 40: differs by up to "), "{listed}");
    assert!(
        listed.contains("; bounds columns ") && listed.contains(", recorded columns 1..30, rows 2..40"),
        "{listed}"
    );
}

#[test]
fn audit_of_a_video_or_without_a_record_explains_itself() {
    let temp = tempfile::tempdir().unwrap();
    let video = temp.path().join("a.mkv");
    let path = video.to_str().unwrap();
    composite("40..42", &video, &["--lossless"]);
    let passed = stdout_of(&["audit", "-q", path]);
    assert!(passed.contains("output: as it was written") && passed.contains("2 of 2 recomputed"), "{passed}");
    // Made by another ffmpeg, and with another seed.
    let record = std::fs::read(record_path(&video)).unwrap();
    edit_record(&video, |value| {
        assert!(value["programs"]["ffmpeg"].as_str().unwrap().starts_with("ffmpeg version "), "{value}");
        value["programs"]["ffmpeg"] = "ffmpeg version 0".into();
        value["command"]["arguments"].as_array_mut().unwrap().extend(["--seed".into(), "3".into()]);
        value["seed"] = 3.into();
    });
    let listed = found_by_audit(&[path, "--sample", "1"]);
    assert!(listed.contains("another ffmpeg: the output was made with \"ffmpeg version 0\""), "{listed}");
    std::fs::write(record_path(&video), record).unwrap();
    let mut bytes = std::fs::read(&video).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&video, bytes).unwrap();
    let listed = found_by_audit(&[path, "--files-only"]);
    assert!(listed.contains("a.mkv (output): has changed since it was written"), "{listed}");
    std::fs::remove_file(record_path(&video)).unwrap();
    assert!(refused(&["audit", path]).contains("an output without a record cannot be checked"));
}

#[test]
fn audit_covers_the_files_of_masks_and_the_recorded_masks() {
    let temp = tempfile::tempdir().unwrap();
    let at = |name: &str| temp.path().join(name);
    composite("40..42", &at("a"), &["--masks", at("masks").to_str().unwrap()]);
    let output = at("a").to_str().unwrap().to_owned();
    let passed = stdout_of(&["audit", "-q", &output]);
    assert!(passed.contains("masks: 2 of 2 files as recorded"), "{passed}");
    assert!(passed.contains("masks: 2 of 2 recomputed are equal"), "{passed}");
    std::fs::copy(at("masks/mask_000041.png"), at("masks/mask_000040.png")).unwrap();
    let listed = found_by_audit(&[&output, "--files-only"]);
    assert!(listed.contains("mask_000040.png (mask): is not the recorded mask"), "{listed}");
    assert!(listed.contains("output: as it was written"), "{listed}");
    // The record agrees with the exchanged file, but not with the recomputed mask.
    edit_record(&at("a"), |value| value["pictures"][0]["mask"] = value["pictures"][1]["mask"].clone());
    let listed = found_by_audit(&[&output, "--sample", "1"]);
    assert!(
        listed.contains("1 of 1 files as recorded") && listed.contains("frame 40: its mask differs in "),
        "{listed}"
    );
}

// Slow: takes a photograph of the demonstration four times.
#[test]
fn audit_repeats_photographs_and_case_cards() {
    let temp = tempfile::tempdir().unwrap();
    let at = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    let text = copy_scene(Path::new(&at("scene.toml")));
    let case = "case_number = \"1\"\ndate = \"2026\"\nplace = \"Office\"\nphotographer = \"A\"\n";
    std::fs::write(at("case.toml"), case).unwrap();
    let (card, photo) = (at("series/001.png"), at("series/002.jpg"));
    stdout_of(&["case-card", &at("case.toml"), "-o", &card]);
    let arguments = ["photo", "recordings/demo", "--frame", "40", "--scene", &at("scene.toml"), "--lux", "300"];
    let small =
        ["--set", "shadow.cast=false", "--width", "160", "--seed", "3", "--mark", "Training", "-q", "-o", &photo];
    stdout_of(&[&arguments[..], &small].concat());
    let record = Record::read(Path::new(&photo)).unwrap();
    assert_eq!(record.work.settings.mark.as_deref(), Some("Training"));
    let picture = image::open(&photo).unwrap().to_rgb8();
    let is_light = |pixel: &image::Rgb<u8>| pixel.0.iter().all(|code| *code > 150);
    let plate_start = picture.height() - 14;
    let light = picture.enumerate_pixels().filter(|(x, y, pixel)| *x < 60 && *y >= plate_start && is_light(pixel));
    // The floor has none there.
    assert!(light.count() > 10, "letters");
    let passed = stdout_of(&["audit", "-q", &at("series")]);
    assert!(passed.starts_with("001.png\ninputs: 1 of 1 as recorded\noutput: as it was written\n"), "{passed}");
    assert!(passed.contains("\n002.jpg\n"), "{passed}");
    assert_eq!(
        passed.matches("pictures: 1 of 1 recomputed are equal to the record bit for bit").count(),
        2,
        "{passed}"
    );

    // A picture without a record, and a contact sheet, which never has one.
    for name in ["series/003.png", "series/002-sheet.png"] {
        std::fs::copy(&card, at(name)).unwrap();
    }
    let listed = found_by_audit(&[&at("series"), "--files-only"]);
    assert!(listed.contains("003.png: has no record") && !listed.contains("002-sheet"), "{listed}");
    std::fs::remove_file(at("series/003.png")).unwrap();

    std::fs::write(at("scene.toml"), text.replacen("version = 1", "version = 1 # touched", 1)).unwrap();
    std::fs::write(at("case.toml"), case.replace("Office", "Garden")).unwrap();
    let listed = found_by_audit(&[&at("series")]);
    assert!(
        listed.contains("scene.toml (scene): has changed: ") && listed.contains("case.toml (card): has"),
        "{listed}"
    );
    assert!(
        listed.contains("picture: differs by up to ") && listed.contains("pictures: 1 of 1 recomputed"),
        "{listed}"
    );
    std::fs::write(at("scene.toml"), &text).unwrap();
    // Another Exif, and a retouched picture.
    let bytes = std::fs::read(&photo).unwrap();
    std::fs::write(&photo, [&bytes[..], b"more"].concat()).unwrap();
    let listed = found_by_audit(&[&photo, "--files-only"]);
    assert!(listed.contains("its pixels are as they were written, but other data has changed"), "{listed}");
    std::fs::copy(&card, &photo).unwrap();
    let listed = found_by_audit(&[&photo, "--files-only"]);
    assert!(listed.contains("002.jpg (output): its pixels have changed since it was written"), "{listed}");
    std::fs::write(&photo, bytes).unwrap();
    // Another film speed in the record, then another seed.
    let edited = |change: fn(&mut Value)| {
        edit_record(Path::new(&photo), change);
        refused(&["audit", "-q", &photo])
    };
    let error = edited(|value| value["photograph"]["view"]["iso"] = 50.0.into());
    assert!(error.contains("states other particulars than the picture has"), "{error}");
    let error = edited(|value| value["seed"] = 4.into());
    assert!(error.contains("another seed than the record states"), "{error}");
}
