//! Checks with values worked out by hand: each one fires on a wrong photograph, and none on a right
//! one.

use super::entry::{LogEntry, PhotoLog, log_files, photographs};
use super::finding::Check;
use super::{COLUMNS, ShotClass, csv, html, view_findings};
use crate::photo::card::CaseCard;
use crate::photo::particulars::{
    CameraSupport, ObjectInView, Particulars, PhotoContent, ScaleInView, Subject, ViewParticulars,
};
use crate::photo::plane_view::{height_error, tilt_error};
use crate::photo::record::write_record;
use crate::provenance::WorkRecord;
use crate::scene::ObjectKind;

fn object(name: &str, kind: ObjectKind, size_m: f64, x_m: f64, mm_per_px: f64, bounds_px: [f64; 4]) -> ObjectInView {
    ObjectInView {
        name: name.to_owned(),
        kind,
        size_m,
        centre_m: [x_m, 0.0, 0.0],
        distance_m: 1.0,
        mm_per_px,
        share: 0.05,
        in_view: if bounds_px == [0.0; 4] { 0.0 } else { 1.0 },
        bounds_px,
    }
}

/// A knife of 240 mm and a scale of 105 mm beside it, square from above, on 1800 × 1200 px: 0.25 mm
/// per px, a field of 0.45 m. Diagonal 2163 px: circles up to 1.44 px are sharp, motion up to 2 px.
fn close_up() -> ViewParticulars {
    ViewParticulars {
        recording: "recordings/demo".to_owned(),
        frame: 71,
        width_px: 1800,
        height_px: 1200,
        focal_length_mm: 50.0,
        equivalent_mm: 50.0,
        f_number: 8.0,
        shutter_s: 1.0 / 60.0,
        iso: 400.0,
        support: CameraSupport::Tripod,
        exposure_deviation_ev: 0.3,
        clipped_share: 0.0,
        focus_distance_m: Some(1.0),
        sharp_from_m: 0.9,
        sharp_to_m: Some(1.1),
        subject: Some(Subject {
            name: "knife".to_owned(),
            is_named: true,
            distance_m: 1.0,
            angle_deg: 3.0,
            mm_per_px: 0.25,
            defocus_px: 1.0,
            motion_px: Some(1.0),
            clipped_share: 0.001,
            scale: Some(scale(2.0, 0.001)),
        }),
        objects: vec![
            object("knife", ObjectKind::Evidence, 0.24, 0.0, 0.25, [300.0, 500.0, 1260.0, 600.0]),
            object("marker 3", ObjectKind::Marker, 0.11, 0.2, 0.25, [0.0; 4]),
            object("scale", ObjectKind::Scale, 0.105, 0.05, 0.25, [300.0, 650.0, 720.0, 1070.0]),
        ],
    }
}

fn scale(tilt_deg: f64, height_m: f64) -> ScaleInView {
    ScaleInView {
        name: "scale".to_owned(),
        tilt_deg,
        tilt_error: Some(tilt_error(tilt_deg)),
        height_m,
        height_error: height_error(height_m, 1.0),
    }
}

fn without_scale() -> ViewParticulars {
    let mut view = close_up();
    view.subject.as_mut().unwrap().scale = None;
    view.objects.pop();
    view
}

/// The knife from farther away: a field of `field_m`, the marker in view.
fn from_afar(field_m: f64) -> ViewParticulars {
    let mut view = without_scale();
    let mm_per_px = 1e3 * field_m / 1800.0;
    view.objects[0].mm_per_px = mm_per_px;
    view.objects[1] = object("marker 3", ObjectKind::Marker, 0.11, 0.2, mm_per_px, [900.0, 500.0, 990.0, 590.0]);
    view
}

fn checks(view: &ViewParticulars) -> Vec<Check> {
    view_findings(view).into_iter().map(|finding| finding.check).collect()
}

/// The faults of a photograph after a change.
fn after(change: impl FnOnce(&mut ViewParticulars, &mut Subject)) -> (Vec<Check>, String) {
    let mut view = close_up();
    let mut subject = view.subject.take().unwrap();
    change(&mut view, &mut subject);
    view.subject = Some(subject);
    let findings = view_findings(&view);
    (checks(&view), findings.iter().map(|f| format!("{}: {}", f.fault, f.remedy)).collect())
}

#[test]
fn right_photographs_have_no_fault() {
    for view in [close_up(), without_scale(), from_afar(2.0), from_afar(13.0)] {
        assert_eq!(view_findings(&view), []);
    }
}

#[test]
fn exposure_is_reported_with_stops_and_the_right_time() {
    let (faults, text) = after(|view, _| view.exposure_deviation_ev = 1.3);
    assert_eq!(faults, [Check::Exposure]);
    // 1/60 s / 2^1.3 = 1/148 s; the nearest third is 1/160 s.
    assert!(text.starts_with("overexposed by 1.3 stops: take it with 1/160 s"), "{text}");
    let (faults, text) = after(|view, _| view.exposure_deviation_ev = -2.0);
    assert!(faults == [Check::Exposure] && text.contains("underexposed by 2.0 stops: take it with 1/15 s"), "{text}");
    assert_eq!(after(|view, _| view.exposure_deviation_ev = -0.6).0, []);
}

#[test]
fn clipping_is_reported_by_subject_and_by_picture() {
    let (faults, text) = after(|_, subject| subject.clipped_share = 0.042);
    assert!(faults == [Check::ClippedHighlights] && text.contains("4.2 % of the subject"), "{text}");
    assert_eq!(after(|view, _| view.clipped_share = 0.06).0, [Check::ClippedHighlights]);
    assert_eq!(after(|view, _| view.clipped_share = 0.04).0, []);
}

#[test]
fn shutter_by_hand_follows_one_over_the_focal_length() {
    let by_hand = |shutter_s: f64| {
        after(move |view, subject| {
            (view.support, view.shutter_s) = (CameraSupport::HandHeld, shutter_s);
            subject.motion_px = Some(14.24);
        })
    };
    let (faults, text) = by_hand(0.125);
    assert_eq!(faults, [Check::ShutterByHand]);
    // ISO 400 · (1/8) / (1/50.8) / 2^0.3 = 2064.
    assert!(
        text.contains("1/8 s by hand") && text.contains("14.2 px") && text.ends_with("or take ISO 2000 for 1/50 s"),
        "{text}"
    );
    assert_eq!(by_hand(1.0 / 50.0).0, [Check::MotionBlur]);
    assert_eq!(after(|view, _| view.shutter_s = 1.0).0, []);
    assert_eq!(after(|_, subject| subject.motion_px = Some(2.1)).0, [Check::MotionBlur]);
    assert_eq!(after(|_, subject| subject.motion_px = None).0, []);
}

#[test]
fn remedy_for_shake_is_an_engraved_and_right_exposure_or_a_tripod() {
    let remedy = |equivalent_mm: f64, iso: f64, off_ev: f64| {
        after(move |view, _| {
            (view.support, view.shutter_s) = (CameraSupport::HandHeld, 0.125);
            (view.equivalent_mm, view.iso, view.exposure_deviation_ev) = (equivalent_mm, iso, off_ev);
        })
        .1
    };
    let ends = |text: String, end: &str| assert!(text.ends_with(end), "{text}");
    // 1/400 s is longer than 1/442 s. ISO 400 · (1/8) · 512 / 2^0.3 = 20793.
    ends(remedy(442.0, 400.0, 0.3), "or take ISO 20000 for 1/500 s");
    // ISO 400 · (1/8) · 50.8 / 2^3 = 317.
    ends(remedy(50.0, 400.0, 3.0), "or take ISO 320 for 1/50 s");
    // At ISO 100 six stops too much: (1/8) · 4 / 2^6 s = 1/128 s.
    ends(remedy(50.0, 400.0, 6.0), "or take ISO 100 for 1/125 s");
    // ISO 6400 · (1/8) · 50.8 / 2^0.3 = 33015, which no camera has.
    ends(
        remedy(50.0, 6400.0, 0.3),
        "expect shake from 1/50 s on; the subject moved by 1.0 px: put the camera on a tripod",
    );
}

#[test]
fn tilted_close_up_is_reported_with_the_foreshortening() {
    // 1 − cos 45° = 29.3 %.
    let (faults, text) = after(|_, subject| subject.angle_deg = 45.0);
    assert!(faults == [Check::TiltedView] && text.contains("45° off") && text.contains("29.3 % short"), "{text}");
    assert_eq!(after(|_, subject| subject.angle_deg = 9.9).0, []);
    let mut view = from_afar(2.0);
    view.subject.as_mut().unwrap().angle_deg = 60.0;
    assert_eq!(checks(&view), [], "only close-ups are measured");
}

#[test]
fn scale_out_of_plane_is_reported_with_its_error() {
    let (faults, text) = after(|_, subject| subject.scale = Some(scale(12.0, 0.0)));
    assert_eq!(faults, [Check::ScaleOutOfPlane]);
    assert!(text.starts_with("scale lies 12° out of the plane of knife: 2.2 % error"), "{text}");
    let edge = || Some(ScaleInView { tilt_error: None, ..scale(90.0, 0.0) });
    assert!(after(|_, subject| subject.scale = edge()).1.contains("no measurement is possible"));
    let (faults, text) = after(|_, subject| subject.scale = Some(scale(0.0, -0.021)));
    assert!(faults == [Check::ScaleHeight] && text.contains("21 mm below") && text.contains("2.1 % error"), "{text}");
}

#[test]
fn cut_off_and_small_scales_are_reported() {
    let (faults, text) = after(|view, _| view.objects[2].in_view = 0.62);
    assert!(faults == [Check::ScaleCutOff] && text.contains("62.0 % of it"), "{text}");
    // 75 px long, uncertain by 1/75.
    let (faults, text) = after(|view, _| view.objects[2].bounds_px = [400.0, 650.0, 475.0, 700.0]);
    assert!(faults == [Check::ScaleTooSmall] && text.contains("75 px long") && text.contains("1.3 %"), "{text}");
}

#[test]
fn subject_out_of_focus_is_reported_with_the_depth_of_field() {
    let (faults, text) = after(|_, subject| subject.defocus_px = 6.2);
    assert_eq!(faults, [Check::OutOfFocus]);
    assert!(
        text.contains("6.2 px (up to 1.4 px") && text.contains("f/8 the depth of field is 0.90 m to 1.10 m"),
        "{text}"
    );
    assert_eq!(after(|_, subject| subject.defocus_px = 1.4).0, []);
}

#[test]
fn small_and_cut_off_subjects_are_reported() {
    let mut view = without_scale();
    view.objects[0].bounds_px = [300.0, 500.0, 660.0, 600.0];
    // 360 of 1800 px.
    let faults = view_findings(&view);
    assert!(faults.len() == 1 && faults[0].check == Check::SubjectTooSmall, "{faults:?}");
    assert!(faults[0].fault.contains("covers 20.0 % of the picture's side (close-up: 25 % or more)"), "{faults:?}");
    // With the scale, from 300 to 720 px: 23 % of the width, 35 % of the height.
    let (faults, text) = after(|view, _| {
        view.objects[0].bounds_px = [300.0, 650.0, 660.0, 750.0];
    });
    assert!(faults == [Check::SubjectTooSmall] && text.contains("knife and scale cover 35.0 %"), "{text}");
    assert_eq!(after(|view, _| view.objects[0].in_view = 0.8).0, [Check::SubjectCutOff]);
}

/// A picture of 180 × 120 px: the knife fills half of it with 96 px.
#[test]
fn close_up_of_an_item_under_100_px_is_a_fault_and_does_not_count() {
    let mut view = without_scale();
    (view.width_px, view.height_px) = (180, 120);
    view.objects[0].mm_per_px = 2.5;
    view.objects[0].bounds_px = [30.0, 50.0, 126.0, 60.0];
    let faults = view_findings(&view);
    assert!(faults.len() == 1 && faults[0].check == Check::SubjectTooSmall, "{faults:?}");
    assert_eq!(faults[0].fault, "knife is 96 px at 2.50 mm per px (close-up: 100 px or more)");
    let mut contents = whole_series();
    contents[3] = PhotoContent::View(Box::new(view));
    assert_eq!(series_checks(&log_of(contents)).0, [Check::NoCloseUp]);
}

#[test]
fn photograph_without_a_named_subject_is_an_overview_from_a_metre_on() {
    let named_item = |is_named: bool, field_m: f64| {
        let mut view = from_afar(field_m);
        view.subject.as_mut().unwrap().is_named = is_named;
        ShotClass::of(&view, &view.objects[0])
    };
    assert_eq!(named_item(true, 2.0), Some(ShotClass::MidRange));
    assert_eq!(named_item(false, 2.0), Some(ShotClass::Overview));
    assert_eq!(named_item(false, 0.98), Some(ShotClass::MidRange));
    assert_eq!(named_item(false, 0.4), Some(ShotClass::CloseUp));
}

#[test]
fn mid_range_needs_a_fixed_point() {
    let mut view = from_afar(2.0);
    view.objects[1].in_view = 0.4;
    assert_eq!(checks(&view), [Check::NoFixedPoint]);
}

fn entry(number: u32, content: PhotoContent) -> LogEntry {
    let particulars = Particulars { number, taken: format!("2026-11-30 12:00:{number:02}"), content };
    LogEntry::new(format!("{number:03}.jpg").into(), Ok(Some(particulars)))
}

fn card() -> PhotoContent {
    let text = str::to_owned;
    let (date, photographer) = (text("30 Nov 2026"), text("A. <B>"));
    PhotoContent::Card(CaseCard {
        case_number: text("2026-0142"),
        date,
        place: text("Office"),
        photographer,
        ..CaseCard::default()
    })
}

fn whole_series() -> Vec<PhotoContent> {
    let views = [from_afar(13.0), from_afar(2.0), without_scale(), close_up()];
    std::iter::once(card()).chain(views.map(|view| PhotoContent::View(Box::new(view)))).collect()
}

fn log_of(contents: Vec<PhotoContent>) -> PhotoLog {
    let mut entries: Vec<_> = (1..).zip(contents).map(|(number, content)| entry(number, content)).collect();
    entries.reverse();
    PhotoLog::of_entries(entries)
}

/// Checks of the series, and its faults as text.
fn series_checks(log: &PhotoLog) -> (Vec<Check>, String) {
    let all: Vec<_> = log.findings.iter().chain(log.items.iter().flat_map(|item| &item.findings)).collect();
    (all.iter().map(|f| f.check).collect(), all.iter().map(|f| format!("{}. ", f.fault)).collect())
}

#[test]
fn whole_series_has_no_fault_and_its_item_is_named_by_the_marker() {
    let log = log_of(whole_series());
    assert_eq!((log.finding_count(), log.items.len()), (0, 1));
    let item = &log.items[0];
    assert_eq!(item.title(), "knife (marker 3)");
    assert_eq!(
        (&item.overviews, &item.mid_ranges, &item.close_ups, &item.with_scale),
        (&vec![2], &vec![3], &vec![4], &vec![5])
    );
    assert_eq!(log.entries.iter().filter_map(LogEntry::number).collect::<Vec<_>>(), [1, 2, 3, 4, 5]);
}

#[test]
fn series_without_one_of_its_photographs_has_that_fault() {
    let lacks = [
        (0, Check::NoCaseCard, "the first frame, number 1, is no case card"),
        (1, Check::NoOverview, "knife (marker 3) has no overview"),
        (2, Check::NoMidRange, "knife (marker 3) has no mid-range photograph"),
        (3, Check::NoCloseUp, "knife (marker 3) has no close-up without scale"),
        (4, Check::NoCloseUpWithScale, "knife (marker 3) has no close-up with scale"),
    ];
    for (n, check, fault) in lacks {
        let mut contents = whole_series();
        contents.remove(n);
        let (checks, text) = series_checks(&log_of(contents));
        assert!(checks == [check] && text.starts_with(fault), "{checks:?} {text}");
    }
}

#[test]
fn oblique_close_ups_with_scale_do_not_count() {
    let mut view = close_up();
    view.subject.as_mut().unwrap().angle_deg = 45.0;
    let mut contents = whole_series();
    contents[4] = PhotoContent::View(Box::new(view));
    let (checks, text) = series_checks(&log_of(contents));
    assert_eq!(checks, [Check::CloseUpNotSquare]);
    assert!(text.contains("with scale (1)") && text.contains("number 5 is 45° off"), "{text}");
}

#[test]
fn gaps_and_repeated_numbers_are_reported() {
    let numbered = |numbers: [u32; 3]| {
        let log = PhotoLog::of_entries(numbers.map(|number| entry(number, card())).into());
        series_checks(&log)
    };
    assert_eq!(numbered([1, 2, 3]).0, []);
    assert_eq!(numbered([1, 2, 5]), (vec![Check::Numbers], "numbers between 2 and 5 are missing. ".to_owned()));
    assert_eq!(numbered([1, 2, 2]), (vec![Check::Numbers], "number 2 occurs twice. ".to_owned()));
}

#[test]
fn marker_without_evidence_is_an_item_of_its_own() {
    let mut view = from_afar(13.0);
    view.objects[1].centre_m = [0.7, 0.0, 0.0];
    let log = log_of(vec![card(), PhotoContent::View(Box::new(view))]);
    assert_eq!(log.items.iter().map(|item| item.title()).collect::<Vec<_>>(), ["knife", "marker 3"]);
}

#[test]
fn photographs_without_a_record_come_last_with_the_reason() {
    let bad = LogEntry::new("000.jpg".into(), Err("000.jpg.record.json: cannot be read".to_owned()));
    let log = PhotoLog::of_entries(vec![bad, entry(1, card())]);
    assert_eq!(log.entries[1].findings[0].check, Check::NoRecord);
    assert_eq!((log.entries[0].number(), log.entries[1].number()), (Some(1), None));
}

#[test]
fn table_has_a_field_for_each_column() {
    let log = log_of(whole_series());
    let csv = csv(&log.entries);
    let lines: Vec<&str> = csv.split("\r\n").collect();
    assert_eq!((lines.len(), lines[6]), (7, ""));
    assert_eq!(lines[0].split(',').count(), COLUMNS.len());
    assert_eq!(
        lines[5],
        "5,005.jpg,2026-11-30 12:00:05,knife,close-up,50.0,50,8,1/60,400,tripod,0.30,1.000,1.000,3.0,0.2500,scale,2.0,\
         recordings/demo,71,"
    );
}

#[test]
fn page_embeds_thumbnails_and_escapes_text() {
    let temp = tempfile::tempdir().unwrap();
    let at = |name: &str| temp.path().join(name);
    for (number, content) in (1..).zip(whole_series()) {
        let path = at(&format!("{number:03}.jpg"));
        image::RgbImage::from_pixel(900, 600, image::Rgb([90, 120, 150])).save(&path).unwrap();
        let particulars = Particulars { number, taken: "2026-11-30 12:00:00".to_owned(), content };
        write_record(&path, &particulars, WorkRecord::without_shot(Vec::new())).unwrap();
    }
    let log = PhotoLog::read(&photographs(&[temp.path().to_owned()]).unwrap());
    let page = html(&log).unwrap();
    assert_eq!(page.matches("data:image/jpeg;base64,").count(), 5);
    assert!(page.contains("A. &lt;B&gt;") && !page.contains("<B>"), "escaped");
    assert!(page.contains("knife (marker 3)") && page.contains("5 photographs, 1 item, 0 faults"));
    assert_eq!(log.entries[0].thumbnail().unwrap().dimensions(), (360, 240));
    let faulty = html(&log_of(vec![card(), PhotoContent::View(Box::new(from_afar(13.0)))])).unwrap();
    assert!(faulty.contains("--aim") && !faulty.contains('`'), "options without marks of code");
    std::fs::remove_file(at("003.jpg")).unwrap();
    assert!(photographs(&[temp.path().to_owned()]).unwrap_err().contains("003.jpg: does not exist"));
    assert!(photographs(&[at("")]).is_err());
}

#[test]
fn log_has_two_files_whichever_ending_is_given() {
    let names = |output: &str| log_files(output.as_ref()).map(|path| path.display().to_string());
    for output in ["out/log", "out/log.csv", "out/log.HTML"] {
        assert_eq!(names(output), ["out/log.csv", "out/log.html"]);
    }
    assert_eq!(names("2026.11"), ["2026.11.csv", "2026.11.html"]);
}
