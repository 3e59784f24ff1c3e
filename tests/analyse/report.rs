//! The report page of an analysis, and the values that a profile accepts from it, by the program.

use std::path::Path;

use crate::footage::{demo_by_tier, leave_out_light_by_tier};
use crate::light::analysed_demo;
use crate::program::{refused, stdout_of};
use crate::tier::is_full;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use locard::analyse::Analysis;
use locard::recording::OpenOptions;
use locard::shot::{Shot, ShotOptions};
use locard::simulate::Flaws;
use quick_xml::events::Event;

/// Content of the page: the text of all elements, decoded pictures, and element names. Panics if an
/// element is not closed.
struct Page {
    text: String,
    pictures: Vec<image::RgbImage>,
    elements: Vec<String>,
}

fn parsed(html: &str) -> Page {
    let mut page = Page { text: String::new(), pictures: Vec::new(), elements: Vec::new() };
    let mut reader = quick_xml::Reader::from_str(html);
    loop {
        match reader.read_event().unwrap() {
            Event::Eof => return page,
            Event::Text(text) => page.text += &text.decode().unwrap(),
            Event::GeneralRef(name) => {
                let code = name.resolve_char_ref().unwrap();
                page.text.push(code.unwrap_or_else(|| match name.decode().unwrap().as_ref() {
                    "amp" => '&',
                    "lt" => '<',
                    "gt" => '>',
                    "quot" => '"',
                    other => panic!("&{other};"),
                }));
            }
            Event::Start(element) => page.elements.push(String::from_utf8(element.name().0.to_vec()).unwrap()),
            Event::Empty(element) => {
                let name = String::from_utf8(element.name().0.to_vec()).unwrap();
                if name == "img" {
                    let uri = element.try_get_attribute("src").unwrap().unwrap();
                    let uri = String::from_utf8(uri.value.to_vec()).unwrap();
                    let png = STANDARD.decode(uri.strip_prefix("data:image/png;base64,").unwrap()).unwrap();
                    page.pictures.push(image::load_from_memory(&png).unwrap().to_rgb8());
                }
                page.elements.push(name);
            }
            _ => {}
        }
    }
}

/// Size of the picture of the room's light, px.
const LIGHT_SIZE: (u32, u32) = (768, 384);

#[test]
fn report_shows_the_light_of_the_room_once() {
    let (folder, _) = analysed_demo();
    let [site, page] = ["site", "page.html"].map(|name| folder.path().join(name));
    stdout_of(&["analyse", site.to_str().unwrap(), "--report", page.to_str().unwrap()]);
    let page = parsed(&std::fs::read_to_string(&page).unwrap());
    assert!(page.text.contains("The light of the room"), "{}", page.text);
    assert_eq!(page.pictures.iter().filter(|picture| picture.dimensions() == LIGHT_SIZE).count(), 1);
}

/// In the fast tier without the room's light, which `report_shows_the_light_of_the_room_once`
/// checks.
// Slow: two analyses of pictures large enough for the spread, and five pages.
#[test]
fn report_shows_the_findings_and_the_profile_accepts_the_camera_values() {
    // Poses 20 ms late; a file name that contains markup.
    let folder = demo_by_tier(24, &Flaws { poses_later_s: 0.02, ..Flaws::default() }, 2);
    let site = folder.path().join("a<b>&\"c");
    std::fs::rename(folder.path().join("site"), &site).unwrap();
    let described = std::fs::read_to_string(site.join("recording.toml")).unwrap();
    std::fs::write(site.join("recording.toml"), described.replace("\"demo\"", "\"<script>&'\"")).unwrap();
    let [page, profile] = ["page.html", "mine.toml"].map(|name| folder.path().join(name));
    let text = "# mine\nversion = 1\n\n[camera]\n# by hand\nreadout_time_s = 0.03 # guessed\n";
    std::fs::write(&profile, text).unwrap();
    let shot = Shot::open(&site, &OpenOptions::default(), &ShotOptions::default()).unwrap();
    leave_out_light_by_tier(&shot, &folder.path().join("a<b>&\"c.analysis"));
    let [site, page_at, profile_at] = [&site, &page, &profile].map(|path| path.to_str().unwrap());
    let stdout = stdout_of(&["analyse", site, "--report", page_at, "--accept", profile_at]);
    let (findings, accepted) = stdout.split_at(stdout.find("accepted ").unwrap());
    assert!(findings.contains("refined"), "{stdout}");

    let html = std::fs::read_to_string(&page).unwrap();
    let page_content = parsed(&html);
    for line in findings.lines() {
        assert!(page_content.text.contains(line[11..].trim()), "{line}");
    }
    assert!(
        page_content.text.contains("<script>&'") && page_content.text.contains("a<b>&\"c"),
        "{}",
        page_content.text
    );
    assert!(!page_content.elements.iter().any(|name| name == "script" || name == "b>"));
    assert!(
        !html.contains("http://")
            || html.matches("http://").count() == html.matches("http://www.w3.org/2000/svg").count()
    );
    // Poses and links, and the strip above and below. Light is steady in it.
    assert!(page_content.elements.iter().filter(|name| *name == "svg").count() >= 4, "{:?}", page_content.elements);
    assert!(page_content.pictures.len() >= 8, "{}", page_content.pictures.len());
    // Edges are shown larger than the tracked point, and above and below too; the room's light all
    // around.
    let [followed, edges, light] = [(128, 128), (320, 320), LIGHT_SIZE]
        .map(|size| page_content.pictures.iter().filter(|p| p.dimensions() == size).count());
    assert!(
        followed.is_multiple_of(2) && edges >= 4 && edges.is_multiple_of(2) && light == usize::from(is_full()),
        "{followed} {edges} {light}"
    );
    assert_eq!(followed + edges + light, page_content.pictures.len());
    for title in [
        "The light of the room",
        "Edges of the room",
        "What slides",
        "Sharpness of edges",
        "Response of codes to \
                                                                                              light",
    ] {
        assert!(page_content.text.contains(title), "{title}");
    }
    assert!(page_content.text.contains("Left out: ") && page_content.text.contains("Time by part"));

    // For an existing analysis the same page again, with the stored running time; without it if
    // that was deleted.
    assert_eq!(stdout_of(&["analyse", site, "--report", page_at]), findings);
    let again = std::fs::read_to_string(&page).unwrap();
    let whole = html.split("<section>\n<h2>Time by part").next().unwrap();
    assert!(again.starts_with(whole) && again.contains("Time by part"), "all is the same but for rounded times");
    stdout_of(&["analyse", site, "--report", page_at]);
    assert_eq!(std::fs::read_to_string(&page).unwrap(), again);
    std::fs::remove_file(folder.path().join("a<b>&\"c.analysis/times.txt")).unwrap();
    stdout_of(&["analyse", site, "--report", page_at]);
    let without = std::fs::read_to_string(&page).unwrap();
    assert!(without.starts_with(whole) && !without.contains("Time by part"));

    // The estimated readout time is the demo's own, 15 ms.
    assert!(accepted.contains("camera.readout_time_s: 0.03 -> 0.015"), "{accepted}");
    assert!(accepted.contains("point_spread.sigma_px: unsaid -> "), "{accepted}");
    assert!(accepted.contains("camera.exposure.time_s"), "{accepted}");
    let offset_s = accepted.split("poses.time_offset_s = ").nth(1).unwrap().split(')').next().unwrap();
    assert!((offset_s.parse::<f64>().unwrap() - 0.02).abs() <= 0.0005, "{accepted}");
    let written = std::fs::read_to_string(&profile).unwrap();
    assert!(written.starts_with(&text.replace("0.03", "0.015")), "{written}");
    let is_kept = accepted.contains("camera.exposure.time_s stays: ");
    assert_eq!(written.contains("time_s = 0.0") && written.contains("[camera.exposure]"), !is_kept, "{written}");
    // A second time nothing changes.
    let stdout = stdout_of(&["analyse", site, "--accept", profile_at]);
    assert!(stdout.contains("camera.readout_time_s: 0.015 -> 0.015"), "{stdout}");
    assert_eq!(std::fs::read_to_string(&profile).unwrap(), written);
    // A new profile starts as a copy.
    let new = folder.path().join("new.toml");
    let options = ShotOptions { profile: Some(profile.clone()), ..ShotOptions::default() };
    let shot = Shot::open(Path::new(site), &OpenOptions::default(), &options).unwrap();
    leave_out_light_by_tier(&shot, &folder.path().join("a<b>&\"c.analysis"));
    stdout_of(&["analyse", site, "--profile", profile_at, "--accept", new.to_str().unwrap()]);
    assert_eq!(std::fs::read_to_string(&new).unwrap(), written);
}

#[test]
fn unavailable_findings_are_left_out_with_a_reason() {
    let folder = demo_by_tier(3, &Flaws::default(), 4);
    let site = folder.path().join("site");
    let described = std::fs::read_to_string(site.join("recording.toml")).unwrap();
    let without = described.replace("[depth]\nlist = \"depth.txt\"\nscale = 250.0\n", "");
    assert_ne!(described, without);
    std::fs::write(site.join("recording.toml"), without).unwrap();
    let [page, profile] = ["page.html", "mine.toml"].map(|name| folder.path().join(name));
    let [site, page_at, profile_at] = [&site, &page, &profile].map(|path| path.to_str().unwrap());
    let stdout = stdout_of(&["analyse", site, "--report", page_at, "--accept", profile_at]);
    let page_content = parsed(&std::fs::read_to_string(&page).unwrap());
    assert!(page_content.pictures.is_empty() && !page_content.elements.contains(&"svg".to_owned()));
    for why in ["poses are as recorded: there is no depth", "so no place of the room can be followed"] {
        assert!(page_content.text.contains(why), "{why}: {}", page_content.text);
    }
    assert!(page_content.text.contains("poses kept: there is no depth"), "{}", page_content.text);
    // Nothing was found, so nothing is written.
    assert_eq!(stdout.matches(" stays: ").count(), 3, "{stdout}");
    assert!(!profile.exists());
}

#[test]
fn existing_reports_and_analyses_are_not_overwritten() {
    let folder = demo_by_tier(3, &Flaws::default(), 4);
    let site = folder.path().join("site");
    let path = site.to_str().unwrap();
    let analysis = folder.path().join("site.analysis");
    let is_whole = |name: &str, content: &str| {
        assert_eq!(std::fs::read_to_string(folder.path().join(name)).unwrap(), content);
        assert!(!analysis.exists(), "refused before the work");
        let left = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name());
        assert!(left.into_iter().all(|name| !name.to_string_lossy().contains("partial")));
    };
    for (name, content, option, why) in [
        ("notes.html", "<p>mine</p>", "--report", "is not a report of an analysis, so it is kept"),
        ("mine.toml", "version = 1\n[camera\n", "--accept", "not a profile that can be extended"),
        ("scene.toml", "version = 1\n[[objects]]\nmodel = 'a.glb'\n", "--accept", "there is no table [objects]"),
    ] {
        let file = folder.path().join(name);
        std::fs::write(&file, content).unwrap();
        let problem = refused(&["analyse", path, option, file.to_str().unwrap()]);
        assert!(problem.contains(why), "{problem}");
        is_whole(name, content);
    }
    let within_file = folder.path().join("notes.html/page.html");
    refused(&["analyse", path, "--report", within_file.to_str().unwrap()]);
    let within = analysis.join("page.html");
    std::fs::create_dir(&analysis).unwrap();
    let problem = refused(&["analyse", path, "--report", within.to_str().unwrap()]);
    assert!(
        problem.contains("lies in the folder of the recording's analysis, which is never overwritten"),
        "{problem}"
    );
    std::fs::remove_dir(&analysis).unwrap();
    let list = site.join("rgb.txt");
    let problem = refused(&["analyse", path, "--report", list.to_str().unwrap()]);
    assert!(problem.contains("is an input of this run"), "{problem}");
    assert!(!analysis.exists() && Path::new(&list).exists());
    // An empty file may be overwritten.
    let page = folder.path().join("page.html");
    std::fs::write(&page, "").unwrap();
    stdout_of(&["analyse", path, "--report", page.to_str().unwrap()]);
    assert!(std::fs::read_to_string(&page).unwrap().ends_with("</html>\n"));
    // Links belong to the analysis.
    let links = analysis.join("links.txt");
    if links.exists() {
        std::fs::write(&links, "0 9 1 1\n").unwrap();
        let problem = Analysis::read(&analysis).unwrap_err().to_string();
        assert!(problem.contains("links.txt") && problem.contains("of the 3 frames"), "{problem}");
    }
}
