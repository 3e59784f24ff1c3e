use super::*;
use glam::DVec2;
use proptest::prelude::*;

/// A camera at (1, 2, 3) of the chunk, turned by 90° about z: its x is the chunk's y. The chunk is
/// turned by 90° about x (its z is the world's −y), doubled and displaced by (10, 20, 30).
const CAMERAS: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0">
  <chunk label="Chunk 1" enabled="true">
    <sensors next_id="1">
      <sensor id="0" label="wide" type="frame">
        <resolution width="640" height="480"/>
        <calibration type="frame" class="initial">
          <resolution width="640" height="480"/>
          <f>900</f>
        </calibration>
        <calibration type="frame" class="adjusted">
          <resolution width="640" height="480"/>
          <f>1000</f>
          <cx>10</cx>
          <cy>-5</cy>
          <b1>2</b1>
          <k1>-0.1</k1>
          <k2>0.4</k2>
          <p1>0.02</p1>
          <p2>0.01</p2>
        </calibration>
      </sensor>
    </sensors>
    <components next_id="1" active_id="0">
      <component id="0" label="Component 1">
        <transform>
          <rotation locked="false">1 0 0 0 0 -1 0 1 0</rotation>
          <translation locked="false">10 20 30</translation>
          <scale locked="false">2</scale>
        </transform>
      </component>
    </components>
    <cameras next_id="3" next_group_id="1">
      <group id="0" label="g">
        <camera id="0" sensor_id="0" component_id="0" label="a">
          <transform>0 -1 0 1 1 0 0 2 0 0 1 3 0 0 0 1</transform>
        </camera>
      </group>
      <camera id="1" sensor_id="0" component_id="0" label="b.jpg" enabled="false">
        <transform>0 -1 0 1 1 0 0 2 0 0 1 3 0 0 0 1</transform>
      </camera>
      <camera id="2" sensor_id="7" label="c.jpg"/>
    </cameras>
  </chunk>
</document>
"#;

const MATRIX: &str = "0 -1 0 1 1 0 0 2 0 0 1 3 0 0 0 1";

fn read(text: &str) -> Result<CamerasFile, String> {
    parse(text, Path::new("cameras.xml")).map_err(|e| e.to_string())
}

fn first_pose(contents: &CamerasFile) -> Pose {
    let (at, turn) = contents.cameras[0].data.world_from_camera.unwrap();
    Pose::from_camera_in_world(at, turn)
}

#[test]
fn projected_point_matches_hand_calculation() {
    let contents = read(CAMERAS).unwrap();
    let pose = first_pose(&contents);
    // 2·(1, −3, 2) + (10, 20, 30).
    assert!((pose.position_in_world_m() - DVec3::new(12.0, 14.0, 34.0)).length() < 1e-12);
    // The camera's x is the chunk's y and the world's z, its y the world's −x, its axis the chunk's
    // z and the world's −y. 0.4 to the right, 0.2 down, 2 ahead:
    let in_camera = pose.transform_point(DVec3::new(11.8, 12.0, 34.4));
    assert!((in_camera - DVec3::new(0.4, 0.2, 2.0)).length() < 1e-12, "{in_camera}");
    // u = 0.2, v = 0.1, r² = 0.05: radial 0.996; x' = 0.1992 + 0.02·(0.05 + 0.08) + 2·0.01·0.02 =
    // 0.2022; y' = 0.0996 + 0.01·(0.05 + 0.02) + 2·0.02·0.02 = 0.1011.
    let at = contents.sensors["0"].project(in_camera).unwrap();
    let expected = DVec2::new(320.0 + 10.0 + 0.2022 * 1002.0, 240.0 - 5.0 + 101.1);
    assert!((at - expected).length() < 1e-9, "{at}");
    assert_eq!(contents.up, Some(DVec3::Z));
}

#[test]
fn cameras_without_a_pose_are_counted() {
    let contents = read(CAMERAS).unwrap();
    assert_eq!(
        contents.cameras.iter().map(|c| (c.label.as_str(), c.line)).collect::<Vec<_>>(),
        [("a", 35), ("b.jpg", 39), ("c.jpg", 42)]
    );
    assert_eq!(
        contents.warnings,
        ["cameras.xml: 2 of 3 cameras have no pose: 1 not aligned, 1 disabled (first: b.jpg)"]
    );
    let rig = CAMERAS.replace("sensor_id=\"7\"", "sensor_id=\"7\" master_id=\"0\"");
    assert!(read(&rig).unwrap().warnings[0].contains("1 of a rig, placed relative to another camera"));
    let invalid = CAMERAS.replacen(MATRIX, &MATRIX.replace('1', "nan"), 2).replace(" enabled=\"false\"", "");
    let error = read(&invalid).unwrap_err();
    assert!(
        error.contains("none of its 3 cameras is aligned (1 not aligned, 2 with a pose that is not finite"),
        "{error}"
    );
}

#[test]
fn cameras_of_other_components_have_no_pose() {
    let other = r#"<component id="1"><transform><scale>9</scale></transform></component></components>"#;
    let text = CAMERAS
        .replace("</components>", other)
        .replace("component_id=\"0\" label=\"b.jpg\" enabled=\"false\"", "component_id=\"1\" label=\"b.jpg\"");
    let contents = read(&text).unwrap();
    assert!(
        contents.warnings[0].contains("1 not aligned, 1 in another component (first: b.jpg)"),
        "{:?}",
        contents.warnings
    );
}

#[test]
fn chunk_transform_of_older_versions_is_read() {
    let text = CAMERAS
        .replace("<components next_id=\"1\" active_id=\"0\">", "")
        .replace("<component id=\"0\" label=\"Component 1\">", "")
        .replace("</component>", "")
        .replace("</components>", "")
        .replace(" component_id=\"0\"", "");
    assert_eq!(first_pose(&read(&text).unwrap()), first_pose(&read(CAMERAS).unwrap()));
    let (from, to) = (text.find("<transform>\n").unwrap(), text.find("<cameras").unwrap());
    let bare = format!("{}{}", &text[..from], &text[to..]);
    let contents = read(&bare).unwrap();
    assert!(contents.up.is_none() && contents.warnings.iter().any(|w| w.contains("the chunk has no transform")));
    assert!((first_pose(&contents).position_in_world_m() - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-12);
}

#[test]
fn fisheye_matches_the_formula_of_the_manual() {
    // u = 0.75, v = 1: θ = atan 1.25 = 0.896055385, along (0.6, 0.8): x = 0.537633231, y =
    // 0.716844308. θ² = 0.802915252, radial 1.080291525. x' = 0.580800623 + 0.02·(0.802915252 +
    // 0.578098982) + 0.02·0.385399321 = 0.616128894; y' = 0.774400830 + 0.01·(0.802915252 +
    // 1.027731523) + 0.04·0.385399321 = 0.808123271.
    let text = CAMERAS
        .replace("type=\"frame\" class=\"adjusted\"", "type=\"fisheye\" class=\"adjusted\"")
        .replace("<k1>-0.1</k1>", "<k1>0.1</k1>")
        .replace("<k2>0.4</k2>", "");
    let geometry = &read(&text).unwrap().sensors["0"];
    let at = geometry.project(DVec3::new(1.5, 2.0, 2.0)).unwrap();
    let expected = DVec2::new(330.0 + 0.616_128_894 * 1002.0, 235.0 + 808.123_271);
    assert!(geometry.distortion.model == LensModel::ThinPrismFisheye && (at - expected).length() < 1e-5, "{at}");
    let plain = text.replace("<p1>0.02</p1>", "").replace("<p2>0.01</p2>", "");
    assert_eq!(read(&plain).unwrap().sensors["0"].distortion.model, LensModel::OpencvFisheye);
}

#[test]
fn spherical_camera_is_a_360_picture() {
    let text = CAMERAS.replace("type=\"frame\"", "type=\"spherical\"").replace("640", "960");
    assert!(read(&text).unwrap().sensors["0"].is_equirectangular());
    assert!(
        read(&CAMERAS.replace("type=\"frame\"", "type=\"spherical\"")).unwrap_err().contains("twice as wide as high")
    );
}

#[test]
fn geocentric_world_becomes_east_north_and_up() {
    // At the equator, longitude 90°: x is west, y is up, z is north.
    let text = CAMERAS
        .replace("1 0 0 0 0 -1 0 1 0", "1 0 0 0 1 0 0 0 1")
        .replace("10 20 30", "0 6378237 0")
        .replace(">2</scale>", ">1</scale>");
    let contents = read(&text).unwrap();
    assert!(contents.warnings.iter().any(|w| w.contains("its world is the earth's")), "{:?}", contents.warnings);
    let pose = first_pose(&contents);
    assert!(pose.position_in_world_m().length() < 1e-6);
    // The camera's x is the chunk's y: up; its axis is z: north; its y is −x: east.
    let in_camera = pose.transform_point(DVec3::new(0.2, 2.0, 0.4));
    assert!((in_camera - DVec3::new(0.4, 0.2, 2.0)).length() < 1e-4, "{in_camera}");
    let local = text.replace("<cameras", "<reference>LOCAL_CS[\"Local\"]</reference><cameras");
    assert!(first_pose(&read(&local).unwrap()).position_in_world_m().length() > 6e6);
}

#[test]
fn refusals_name_line_sensor_and_remedy() {
    for (from, to, expected) in [
        ("<document version=\"2.0.0\">", "<document", "cameras.xml, line 3: is damaged or cut off"),
        ("document", "settings", "cameras.xml, line 2: has the root <settings> and no <chunk>; expected <document>"),
        ("<f>1000</f>", "", "cameras.xml, line 5: sensor wide: its calibration has no focal length f"),
        ("<f>1000</f>", "<f>-1</f>", "cameras.xml, line 5: sensor wide: camera.fy_px = -1: expected"),
        ("<f>1000</f>", "<f>nan</f>", "cameras.xml, line 5: sensor wide: f holds NaN; a finite number"),
        ("<f>1000</f>", "<fx>1000</fx>", "cameras.xml, line 5: sensor wide: its calibration has fx, as PhotoScan"),
        ("<k1>-0.1</k1>", "<p3>0.1</p3>", "cameras.xml, line 5: sensor wide: p3 is not 0; adjust"),
        ("<k1>-0.1</k1>", "<b2>9</b2>", "cameras.xml, line 5: sensor wide: the skew displaces pixels by up to 2.2"),
        (
            "type=\"frame\" class=\"adjusted\"",
            "type=\"equisolid_fisheye\" class=\"adjusted\"",
            "cameras.xml, line 5: sensor wide: its type is equisolid_fisheye; expected frame, ",
        ),
        ("width=\"640\"", "width=\"640.5\"", "cameras.xml, line 5: sensor wide: its resolution is 640.5x480"),
        (
            "sensor_id=\"0\"",
            "sensor_id=\"5\"",
            "cameras.xml, line 3: a camera has the sensor 5, which the file does not",
        ),
        (" label=\"a\"", "", "cameras.xml, line 35: the camera has no label"),
        (
            "0 -1 0 1 1 0 0 2",
            "0 -1 0 1 1 0 0",
            "cameras.xml, line 36: camera a: transform holds 15; expected 16 numbers",
        ),
        ("0 -1 0 1 1 0 0 2", "0 -2 0 1 1 0 0 2", "cameras.xml, line 36: camera a: transform is not a rotation"),
        ("3 0 0 0 1<", "3 0 0 0 2<", "cameras.xml, line 36: camera a: transform: the last row must be 0 0 0 1"),
        (">2</scale>", ">0</scale>", "cameras.xml, line 26: transform: scale is 0; expected above 0"),
        ("1 0 0 0 0 -1 0 1 0", "1 0 0 0 0 -1 0 1", "cameras.xml, line 26: transform: rotation holds 8; expected 9"),
    ] {
        // The adjusted calibration is the last.
        let text = match CAMERAS.rfind(from) {
            Some(at) if from.contains("width") => format!("{}{to}{}", &CAMERAS[..at], &CAMERAS[at + from.len()..]),
            _ => CAMERAS.replacen(from, to, if from == "document" { 2 } else { 1 }),
        };
        let error = read(&text).unwrap_err();
        assert!(error.starts_with(expected), "{to}: {error}");
    }
    for length in (0..CAMERAS.len() - 12).step_by(13) {
        assert!(read(&CAMERAS[..length]).unwrap_err().starts_with("cameras.xml, line "));
    }
}

proptest! {
    #[test]
    fn arbitrary_values_never_panic(text in "\\PC*", numbers in "([-0-9.eNa]{1,9} ){16}", value in "[-0-9.eNa]{1,9}") {
        let _ = (read(&text), read(&CAMERAS.replace(MATRIX, &numbers)), read(&CAMERAS.replace("1000", &value)));
        let _ = (read(&CAMERAS.replace("10 20 30", &numbers[..numbers.len() / 2])), read(&CAMERAS.replace("640", &value)));
    }
}
