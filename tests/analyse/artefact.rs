//! Files of an analysis: their place, the conditions of their use, and resumption after an
//! interruption.

use std::path::Path;

use crate::findings::late;
use crate::footage::{demo_by_tier, leave_out_light, opened};
use crate::program::{locard, refused, stdout_of};
use crate::tier::{any_scene, fast_or_full};
use locard::analyse::{Analysis, AnalysisStage, Interrupted, default_folder};
use locard::recording::OpenOptions;
use locard::shot::{Shot, ShotOptions};

// Slow: three analyses.
#[test]
fn interrupted_analysis_resumes_from_its_checkpoint() {
    let folder = demo_by_tier(13, &late(0.01), 2);
    let shot = opened(&folder);
    let [whole, analysis] = ["whole.analysis", "site.analysis"].map(|name| folder.path().join(name));
    // Records progress until the analysis ends, or interrupts it after `max_reports` reports.
    let progress_of = |shot: &Shot, folder: &Path, max_reports: usize| {
        let mut reports = Vec::new();
        let done = shot.analyse(folder, &mut |progress| {
            // Progress of the last stage depends on time.
            if progress.stage != AnalysisStage::Light {
                reports.push(progress.done);
            }
            if reports.len() < max_reports { Ok(()) } else { Err(Interrupted) }
        });
        (reports, done.map(drop))
    };
    leave_out_light(&shot, &whole);
    leave_out_light(&shot, &analysis);
    let (all, done) = progress_of(&shot, &whole, usize::MAX);
    done.unwrap();
    // In the last pass but one: its reports are those of sharpness.
    let (_, done) = progress_of(&shot, &analysis, all.len() - 15);
    assert!(done.unwrap_err().is_interrupted() && !analysis.exists());
    // Checkpoints of another camera are not reused.
    let sets = vec![fast_or_full("camera.fx_px=259.5", "camera.fx_px=519.5").to_owned()];
    let other = Shot::open(
        &folder.path().join("site"),
        &OpenOptions::default(),
        &ShotOptions { sets, ..ShotOptions::default() },
    );
    let elsewhere = folder.path().join("other/site.analysis");
    std::fs::create_dir(folder.path().join("other")).unwrap();
    let part = folder.path().join("site.analysis.part");
    assert!(part.is_dir());
    let to = folder.path().join("other/site.analysis.part");
    std::fs::create_dir(&to).unwrap();
    for entry in part.read_dir().unwrap() {
        let entry = entry.unwrap();
        std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
    }
    assert_eq!(progress_of(&other.unwrap(), &elsewhere, 1).0, all[..1]);
    // Checkpoints of the same camera are, byte for byte.
    let (rest, done) = progress_of(&shot, &analysis, usize::MAX);
    done.unwrap();
    assert!(rest.len() + 4 < all.len() && all.ends_with(&rest), "{rest:?} of {all:?}");
    assert!(!part.exists());
    for name in ["analysis.toml", "poses.txt", "links.txt"] {
        assert_eq!(std::fs::read(whole.join(name)).unwrap(), std::fs::read(analysis.join(name)).unwrap(), "{name}");
    }
    // Truncated at the end of a line.
    for name in ["poses.txt", "links.txt"] {
        let text = std::fs::read_to_string(whole.join(name)).unwrap();
        let half: String = text.lines().take(text.lines().count() / 2).map(|line| format!("{line}\n")).collect();
        std::fs::write(whole.join(name), half).unwrap();
        let problem = Analysis::read(&whole).unwrap_err().to_string();
        assert!(problem.contains(name) && problem.contains("were written"), "{problem}");
        std::fs::write(whole.join(name), text).unwrap();
    }
    assert!(Analysis::read(&whole).is_ok());
}

#[test]
fn file_in_place_of_the_analysis_folder_is_refused_before_the_analysis() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("found");
    std::fs::write(&file, "mine").unwrap();
    let problem = refused(&["analyse", "recordings/demo", "-o", file.to_str().unwrap()]);
    assert!(
        problem.contains("found") && problem.contains("move it elsewhere, or choose another folder (--output)"),
        "{problem}"
    );
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "mine");
}

// Slow: eight composites by the program.
#[test]
fn analysis_beside_the_recording_is_used_while_it_matches() {
    let folder = demo_by_tier(8, &late(0.01), 4);
    let site = folder.path().join("site");
    let path = site.to_str().unwrap();
    leave_out_light(&opened(&folder), &folder.path().join("site.analysis"));
    let stdout = stdout_of(&["analyse", path]);
    assert!(stdout.contains("poses      ") && stdout.contains("readout"), "{stdout}");
    let analysis = folder.path().join("site.analysis");
    assert_eq!(default_folder(&site), analysis.canonicalize().unwrap());
    assert_eq!(stdout_of(&["inspect", analysis.to_str().unwrap()]), stdout);
    assert_eq!(stdout_of(&["analyse", path]), stdout, "once is enough");

    // The use of an analysis shows without shadows, which take most of the time, and by one object.
    let without_shadows = ["--set", "shadow.cast=false", "--set", "shadow.on_evidence=false"];
    let marker = [&["--scene", any_scene()], &without_shadows[..], &["--frames", "2..3", "-o"]].concat();
    let composite = |out: &str, more: &[&str]| {
        let out = folder.path().join(out);
        let arguments = [&["composite", path][..], &marker, &[out.to_str().unwrap()], more].concat();
        let done = locard(&arguments);
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        (std::fs::read(out.join("frame_000002.png")).unwrap(), String::from_utf8(done.stderr).unwrap())
    };
    let (by_default, _) = composite("a", &[]);
    let (named, _) = composite("b", &["--analysis", analysis.to_str().unwrap()]);
    let (without, _) = composite("c", &["--no-analysis"]);
    assert!(by_default == named);

    let (left, message) = composite("r", &["--without", "registration", "--no-analysis"]);
    assert!(
        left == without && message.contains("--without registration changes nothing: no analysis is used"),
        "{message}"
    );

    // Another recording in the same place.
    let poses = std::fs::read_to_string(site.join("groundtruth.txt")).unwrap();
    let dropped: String =
        poses.lines().enumerate().filter(|(n, _)| *n != 3).map(|(_, line)| format!("{line}\n")).collect();
    std::fs::write(site.join("groundtruth.txt"), dropped).unwrap();
    let (stale, message) = composite("d", &[]);
    assert!(
        stale == without
            && message.contains("is not used: the recording has changed since it was made")
            && message.contains("analyse the recording again"),
        "{message}"
    );
    let named = ["composite", path, "--analysis", analysis.to_str().unwrap()];
    let out = folder.path().join("e");
    let problem = refused(&[&named[..], &marker, &[out.to_str().unwrap()]].concat());
    assert!(problem.contains("the recording has changed since it was made"), "{problem}");

    // Half-written, and of another version.
    let toml = analysis.join("analysis.toml");
    let text = std::fs::read_to_string(&toml).unwrap();
    let version: u32 = text.lines().find_map(|line| line.strip_prefix("version = ")?.parse().ok()).unwrap();
    let [this, next] = [version, version + 1].map(|version| format!("version = {version}"));
    std::fs::write(&toml, text.replace(&this, &next)).unwrap();
    let stdout = format!("version {}; this program makes and reads version {version}", version + 1);
    assert!(composite("f", &[]).1.contains(&stdout));
    std::fs::write(&toml, &text[..text.len() / 2]).unwrap();
    assert!(composite("g", &[]).1.contains("is not used"));
    std::fs::remove_file(&toml).unwrap();
    assert!(composite("h", &[]).1.contains("it has no analysis.toml: it is not an analysis, or an unfinished one"));

    // Analysed first, on request.
    let (made, _) = composite("i", &["--analyse"]);
    assert!(toml.exists() && made == composite("j", &[]).0);
    std::fs::remove_file(&toml).unwrap();

    // A folder that is not an analysis is not written into.
    std::fs::write(analysis.join("mine.txt"), "").unwrap();
    let problem = refused(&["analyse", path]);
    assert!(problem.contains("contains mine.txt, which does not belong to an analysis"), "{problem}");
}
