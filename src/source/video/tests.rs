//! Tests of the parsing of `ffprobe`'s answers.

use super::super::orientation::Orientation;
use super::*;
use crate::camera::Curve;
use proptest::prelude::*;

fn parse(stream: &str, packets: &str, overrides: &Overrides) -> Result<Video, String> {
    parse_tall(48, stream, packets, overrides)
}

fn parse_tall(height: u32, stream: &str, packets: &str, overrides: &Overrides) -> Result<Video, String> {
    let json = format!(r#"{{"streams": [{{"width": 64, "height": {height}, {stream}}}], "packets": [{packets}]}}"#);
    parse_probe(json.as_bytes(), Path::new("v.mkv"), overrides).map_err(|e| e.to_string())
}

const ONE: &str = r#"{"pts_time": "0.5"}"#;

#[test]
fn coding_follows_the_pixel_format() {
    use ChromaSiting::{Centered, Cosited};
    let coding = |format: &str, more: &str| {
        let stream = format!(r#""pix_fmt": "{format}"{more}"#);
        parse(&stream, ONE, &Overrides::default()).unwrap().coding
    };
    let chroma = |format: &str, more: &str| coding(format, more).unwrap().chroma.map(|c| (c.factor, c.siting));
    assert_eq!(chroma("yuv420p", ""), Some(([2, 2], [Cosited, Centered])));
    assert_eq!(chroma("yuvj420p", ""), Some(([2, 2], [Centered, Centered])));
    assert_eq!(chroma("nv12", r#", "chroma_location": "topleft""#), Some(([2, 2], [Cosited, Cosited])));
    assert_eq!(chroma("yuyv422", r#", "chroma_location": "center""#), Some(([2, 1], [Centered, Centered])));
    assert_eq!(chroma("yuv444p", r#", "chroma_location": "unspecified""#).map(|c| c.0), Some([1, 1]));
    assert_eq!(chroma("gray", ""), None);
    let color = coding("yuv420p", r#", "color_space": "bt709", "color_range": "pc""#).unwrap().color;
    assert_eq!((color.matrix, color.range), (ColorMatrix::Bt709, ColorRange::Full));
    for format in ["rgb24", "yuv420p10le", "pal8"] {
        assert!(coding(format, "").is_none(), "{format}");
    }
}

#[test]
fn range_and_matrix_as_stated_or_as_usual() {
    use ColorMatrix::*;
    use ColorRange::*;
    for (height, stream, expected) in [
        (719, r#""pix_fmt": "yuv420p""#, (Limited, Bt601, 8)),
        (720, r#""pix_fmt": "yuv420p""#, (Limited, Bt709, 8)),
        (48, r#""pix_fmt": "yuvj420p""#, (Full, Bt601, 8)),
        (48, r#""pix_fmt": "yuv420p10le", "color_range": "pc", "color_space": "bt2020nc""#, (Full, Bt2020, 16)),
        (48, r#""pix_fmt": "yuv444p", "color_space": "bt709", "color_range": "tv""#, (Limited, Bt709, 8)),
        (48, r#""pix_fmt": "gbrp16le", "color_space": "gbr""#, (Full, Rgb, 16)),
        (48, r#""pix_fmt": "rgb565le""#, (Full, Rgb, 8)),
        (48, r#""pix_fmt": "p010le""#, (Limited, Bt601, 16)),
    ] {
        let v = parse_tall(height, stream, ONE, &Overrides::default()).unwrap();
        assert_eq!((v.range, v.matrix, v.bits), expected, "{stream}");
    }
    let overrides = Overrides { range: Some(Full), matrix: Some(Bt709), fps: None, ..Overrides::default() };
    let v = parse(r#""pix_fmt": "yuv420p", "color_space": "smpte170m", "color_range": "tv""#, ONE, &overrides).unwrap();
    assert_eq!((v.range, v.matrix), (Full, Bt709));
    let error = parse(r#""pix_fmt": "yuv420p", "color_space": "ycgco""#, ONE, &Overrides::default()).unwrap_err();
    assert!(error.starts_with("v.mkv: its colour matrix is ycgco; expected"), "{error}");
}

#[test]
fn presentation_is_kept_and_reported() {
    let stream = r#""pix_fmt": "yuv420p10le", "color_space": "bt2020nc", "color_transfer": "smpte2084",
            "color_primaries": "bt2020", "sample_aspect_ratio": "16:15", "side_data_list": [{"rotation": -90}]"#;
    let turned = Orientation { is_mirrored: false, rotation_deg: -90.0 };
    for (as_stored, size, orientation, pixel_aspect, messages) in [
        (true, (64, 48), turned, (16, 15), ["v.mkv: is tagged to be shown turned by 90° clockwise", "but 16:15"]),
        (
            false,
            (48, 64),
            Orientation::default(),
            (15, 16),
            ["v.mkv: its frames are turned by 90° clockwise", "but 15:16"],
        ),
    ] {
        let v = parse(stream, ONE, &Overrides { as_stored, ..Overrides::default() }).unwrap();
        let expected = Presentation {
            orientation,
            pixel_aspect: Some(pixel_aspect),
            transfer: Some("smpte2084"),
            primaries: Some("bt2020"),
            matrix: Some("bt2020nc"),
            timecode: None,
        };
        assert_eq!((v.presentation, (v.width, v.height)), (expected, size));
        for message in messages {
            assert!(v.warnings.iter().any(|w| w.contains(message)), "{message}: {:?}", v.warnings);
        }
    }
    for plain in ["1:1", "0:1", "N/A"] {
        let stream = format!(r#""pix_fmt": "yuv420p", "color_transfer": "unknown", "sample_aspect_ratio": "{plain}""#);
        let v = parse(&stream, ONE, &Overrides::default()).unwrap();
        assert_eq!((v.presentation, v.warnings.len()), (Presentation::default(), 0), "{plain}");
    }
}

#[test]
fn mirrored_video_is_distinguished_from_a_rotated_one() {
    // In ffprobe's format: the angle alone does not show the mirroring.
    for (matrix, rotation, shown) in [
        ([-65536, 0, 0, 65536], -180, "mirrored left to right"),
        ([65536, 0, 0, -65536], 0, "mirrored top to bottom"),
        ([0, 65536, 65536, 0], -90, "mirrored left to right and then turned by 90° counter-clockwise"),
        ([0, 65536, -65536, 0], -90, "turned by 90° clockwise"),
    ] {
        let [a, b, c, d] = matrix;
        let text = format!(r"\n00000000: {a:>12} {b:>12} 0\n00000001: {c:>12} {d:>12} 0\n00000002: 0 0 1073741824\n");
        let sides = format!(r#"[{{"displaymatrix": "{text}", "rotation": {rotation}}}]"#);
        let v = parse(&format!(r#""pix_fmt": "yuv420p", "side_data_list": {sides}"#), ONE, &Overrides::default());
        let v = v.unwrap();
        assert_eq!(v.applied_orientation, Orientation::of_matrix(matrix.map(f64::from)).unwrap());
        let message = format!("v.mkv: its frames are {shown} on reading");
        assert!(v.warnings.iter().any(|warning| warning.starts_with(&message)), "{:?}", v.warnings);
    }
}

/// Horizontally chroma is at the first of two luma samples. Turned clockwise that is the upper one;
/// turned the other way it would be the second one.
#[test]
fn coding_follows_the_applied_orientation() {
    let chroma = |rotation: i32| {
        let stream = format!(r#""pix_fmt": "yuv422p", "side_data_list": [{{"rotation": {rotation}}}]"#);
        let v = parse(&stream, ONE, &Overrides::default()).unwrap();
        v.coding.map(|coding| coding.chroma.unwrap())
    };
    let stored = chroma(0).unwrap();
    assert_eq!((stored.factor, stored.siting[0]), ([2, 1], ChromaSiting::Cosited));
    let turned = chroma(-90).unwrap();
    assert_eq!((turned.factor, turned.siting[1]), ([1, 2], ChromaSiting::Cosited));
    assert_eq!((chroma(90), chroma(180)), (None, None));
}

#[test]
fn unusual_and_unknown_transfer_functions_are_reported() {
    let matrix_and_warning = |name: &str| {
        let stream = format!(r#""pix_fmt": "yuv420p", "color_transfer": "{name}""#);
        let v = parse(&stream, ONE, &Overrides::default()).unwrap();
        (v.presentation.transfer.map(str::to_owned), v.warnings.join("; "))
    };
    for (name, message) in [
        ("log100", "is in a logarithmic scale of 100:1; its code values"),
        ("bt1361e", "is in the extended gamut of BT.1361; its code values are taken for the camera's usual ones"),
    ] {
        let (kept, warning) = matrix_and_warning(name);
        assert!(kept.as_deref() == Some(name) && warning.contains(message), "{name}: {kept:?} {warning}");
        assert!(warning.contains("[camera.response]") && warning.contains(&format!("tagged {name} too")), "{warning}");
    }
    for (name, curve) in
        [("bt709", Curve::Srgb), ("arib-std-b67", Curve::Hlg), ("smpte2084", Curve::Pq), ("linear", Curve::Linear)]
    {
        assert_eq!(matrix_and_warning(name), (Some(name.to_owned()), String::new()));
        let presentation = Presentation { transfer: Some(name), ..Presentation::default() };
        assert_eq!(presentation.response().curve, curve, "{name}");
    }
    let cinema = Presentation { transfer: Some("smpte428"), ..Presentation::default() };
    assert_eq!((cinema.response().curve, cinema.response().gamma), (Curve::Gamma, 2.6));
    let hlg = Presentation { transfer: Some("arib-std-b67"), ..Presentation::default() };
    let warning = hlg.lost_without_tags().unwrap();
    assert!(
        warning.starts_with("is tagged: it is in HLG (high dynamic range); recorded pictures lose the"),
        "{warning}"
    );
    assert_eq!(Presentation::default().lost_without_tags(), None);
    let (kept, warning) = matrix_and_warning("odd");
    assert!(kept.is_none() && warning.contains("the unknown transfer function odd"), "{warning}");
    assert_eq!(matrix_and_warning("bt709"), (Some("bt709".to_owned()), String::new()));
}

#[test]
fn times_in_the_order_shown_and_steady_where_the_file_only_rounds() {
    let stream = r#""pix_fmt": "yuv420p", "avg_frame_rate": "30/1""#;
    let packets =
        r#"{"pts_time": "0.100"}, {"pts_time": "0.167"}, {"pts_time": "0.133"}, {"pts_time": "9", "flags": "_D"}"#;
    let steady = parse(stream, packets, &Overrides::default()).unwrap();
    assert_eq!(steady.timestamps_s, [0.0, 1.0 / 30.0, 2.0 / 30.0]);
    let varying = r#"{"pts_time": "0.0"}, {"pts_time": "0.04"}, {"pts_time": "0.10"}"#;
    assert_eq!(parse(stream, varying, &Overrides::default()).unwrap().timestamps_s, [0.0, 0.04, 0.10]);
    let overrides = Overrides { fps: Some(10.0), ..Overrides::default() };
    assert_eq!(parse(stream, varying, &overrides).unwrap().timestamps_s, [0.0, 0.1, 0.2]);
    assert!(parse(stream, r#"{"flags": "K_"}"#, &Overrides::default()).unwrap().timestamps_s == [0.0]);
    assert!(parse(stream, "", &Overrides::default()).unwrap_err().contains("holds no frames"));
}

#[test]
fn fewer_frames_than_the_container_promises_are_refused() {
    let overrides = Overrides::default();
    let packets = r#"{"pts_time": "0.0"}, {"pts_time": "0.1"}"#;
    let stream = |more: &str| format!(r#""pix_fmt": "yuv420p", "avg_frame_rate": "10/1", {more}"#);
    let error = parse(&stream(r#""nb_frames": "3""#), packets, &overrides).unwrap_err();
    assert!(error.starts_with("v.mkv: holds 2 frames, and its index has 3: is it truncated?"), "{error}");
    let lasting = |text: &str| parse(&stream(&format!(r#""tags": {{"DURATION": "{text}"}}"#)), packets, &overrides);
    let error = lasting("00:01:00.500000000").unwrap_err();
    assert!(error.contains("ends after 0.200 s (2 frames), but its header gives 60.500 s"), "{error}");
    for whole in ["00:00:00.200000000", "00:00:00.400", "odd"] {
        assert!(lasting(whole).is_ok(), "{whole}");
    }
    assert!(parse(&stream(r#""nb_frames": "2""#), packets, &overrides).is_ok());
}

/// As written by `ffmpeg -c copy` from x264's frames: an empty chunk after each, and no
/// presentation times.
#[test]
fn avi_with_empty_chunks_is_whole_and_keeps_its_frames_times() {
    let avi = |count: usize| {
        let packets = (0..count).map(|i| format!(r#"{{"dts": {}, "dts_time": "{:.6}"}}"#, 2 * i, i as f64 / 30.0));
        let json = format!(
            r#"{{"format": {{"format_name": "avi"}}, "packets": [{}], "streams": [{{"width": 64, "height": 48,
                "pix_fmt": "yuv420p", "avg_frame_rate": "60/1", "nb_frames": "24"}}]}}"#,
            packets.collect::<Vec<_>>().join(", ")
        );
        parse_probe(json.as_bytes(), Path::new("v.avi"), &Overrides::default()).map_err(|e| e.to_string())
    };
    let times_s = avi(12).unwrap().timestamps_s;
    assert_eq!(times_s.len(), 12);
    assert!(times_s.iter().enumerate().all(|(i, time_s)| (time_s - i as f64 / 30.0).abs() < 1e-6), "{times_s:?}");
    assert!(avi(1).unwrap_err().contains("ends after 0.017 s (1 frame)"));
    let error = avi(9).unwrap_err();
    assert!(error.starts_with("v.avi: ends after 0.300 s (9 frames), but its header gives 0.400 s"), "{error}");
}

proptest! {
    #[test]
    fn arbitrary_answers_never_panic(stream in "\\PC{0,40}", packets in "[{}\",:a-z0-9.-]{0,40}") {
        let _ = parse(&stream, &packets, &Overrides::default());
    }
}
