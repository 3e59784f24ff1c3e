use super::*;
use crate::camera::{Geometry, Intrinsics, LensModel};
use glam::DVec2;

const SIZE: [u32; 2] = [160, 120];
const PLATE: [u32; 2] = [210, 150];

fn lens() -> Geometry {
    let intrinsics = Intrinsics {
        width_px: SIZE[0],
        height_px: SIZE[1],
        fx_px: 130.0,
        fy_px: 129.0,
        cx_px: 79.0,
        cy_px: 61.0,
        ..Intrinsics::default()
    };
    Geometry::new(intrinsics, Distortion { k1: -0.15, k2: 0.03, p1: 0.002, ..Distortion::default() })
}

fn plate_camera() -> Intrinsics {
    Intrinsics { fx_px: 130.0, fy_px: 130.0, cx_px: 80.0, cy_px: 60.0, ..lens().intrinsics }
}

/// A map in Nuke's convention; places outside the other picture are beyond 0 to 1.
fn picture(size_px: [u32; 2], other: [u32; 2], place_px: impl Fn(DVec2) -> DVec2) -> StPicture {
    let [width, height] = size_px.map(|side| side as usize);
    let st = |n: usize| {
        let at = place_px(DVec2::new((n % width) as f64, (n / width) as f64) + 0.5);
        [(at.x / f64::from(other[0])) as f32, (1.0 - at.y / f64::from(other[1])) as f32]
    };
    StPicture { size_px, corner_px: [0; 2], width, height, st: (0..width * height).map(st).collect() }
}

fn undistort() -> StPicture {
    picture(PLATE, SIZE, |at| lens().project(((at - DVec2::new(105.0, 75.0)) / 130.0).extend(1.0)).unwrap())
}

fn redistort() -> StPicture {
    picture(SIZE, PLATE, |at| lens().unproject(at).unwrap().truncate() * 130.0 + DVec2::new(105.0, 75.0))
}

fn file(key: &'static str, picture: StPicture) -> MapFile {
    MapFile { key, path: "lens.exr".into(), picture }
}

fn of(maps: [Option<StPicture>; 2], size: Option<[u32; 2]>) -> Result<Geometry, String> {
    let [undistort, redistort] = maps;
    let undistort = undistort.map(|map| file(UNDISTORT, map));
    let map = super::lens(undistort.as_ref(), redistort.map(|map| file(REDISTORT, map)).as_ref(), size)?;
    map.check(&plate_camera())?;
    Ok(Geometry::new(plate_camera(), Distortion { model: LensModel::StMap, map: Some(map), ..Default::default() }))
}

/// Largest deviation from the lens's formula over the picture, px.
fn off_px(table: &Geometry) -> f64 {
    let places = (0..=24).flat_map(|y| (0..=32).map(move |x| 5.0 * DVec2::new(x.into(), y.into())));
    places.map(|at| table.project(lens().unproject(at).unwrap()).unwrap().distance(at)).fold(0.0, f64::max)
}

#[test]
fn maps_of_either_direction_and_both_give_the_lens() {
    for (maps, size) in [
        ([Some(undistort()), None], None),
        ([None, Some(redistort())], Some(PLATE)),
        ([Some(undistort()), Some(redistort())], None),
    ] {
        let off_px = off_px(&of(maps, size).unwrap());
        assert!(off_px < 0.005, "{off_px} px");
    }
}

#[test]
fn t_may_count_downwards_and_pixels_may_be_missing_clamped_or_overscan() {
    let downwards = |mut map: StPicture| {
        map.st.iter_mut().for_each(|st| st[1] = 1.0 - st[1]);
        map
    };
    assert!(off_px(&of([Some(downwards(undistort())), None], None).unwrap()) < 0.005);
    // The rim of the picture mixed with empty pixels, as by a filter.
    let mut ragged = undistort();
    for (n, st) in ragged.st.iter_mut().enumerate() {
        let (x, y) = (n % 210, n / 210);
        let rim = x.min(y).min(209 - x).min(149 - y);
        match rim {
            0..2 => *st = [0.0; 2],
            2 => *st = st.map(|value| 0.5 * value),
            _ => {}
        }
    }
    assert!(off_px(&of([Some(ragged), None], None).unwrap()) < 0.05);
    let clamped = redistort();
    let clamped = StPicture { st: clamped.st.iter().map(|st| st.map(|v| v.clamp(0.0, 1.0))).collect(), ..clamped };
    assert!(off_px(&of([Some(undistort()), Some(clamped)], None).unwrap()) < 0.005);
    // The undistorted picture has the recorded one's size, and its pixels lie beyond it.
    let mut overscan = undistort();
    (overscan.size_px, overscan.corner_px) = (SIZE, [-25, -15]);
    assert!(off_px(&of([Some(overscan), None], None).unwrap()) < 0.005);
}

#[test]
fn useless_maps_are_refused_with_the_reason() {
    let changed = |at: usize, st: [f32; 2]| {
        let mut map = undistort();
        map.st[at] = st;
        map
    };
    let fold = picture(SIZE, PLATE, |at| DVec2::new(105.0 + 60.0 * ((at.x - 80.0) / 40.0).sin(), at.y + 15.0));
    let mirrored = picture(PLATE, SIZE, |at| DVec2::new(185.0 - at.x, at.y - 15.0));
    let offsets = StPicture { st: vec![[0.01, -0.02]; 210 * 150], ..undistort() };
    let other = picture(SIZE, PLATE, |at| at + DVec2::new(25.0, 15.0) + 0.02 * (at - DVec2::new(80.0, 60.0)));
    for (maps, size, problem) in [
        ([Some(changed(1000, [f32::NAN, 0.5])), None], None, "holds no number at column 160, row 4"),
        ([Some(changed(201, [640.0, 480.0])), None], None, "divide a map in pixels"),
        ([None, Some(fold)], Some(PLATE), "is not one-to-one: it folds at column"),
        ([Some(mirrored), None], None, "S must grow to the right"),
        ([Some(offsets), None], None, "not offsets"),
        ([Some(undistort()), None], Some([200, 150]), "is 210x150 px, not 200x150 as stated"),
        ([None, Some(redistort())], None, "state the size as undistorted_width_px and undistorted_height_px"),
        ([Some(undistort()), Some(other)], None, "do not invert each other"),
        ([Some(redistort()), Some(undistort())], None, "are `undistort` and `redistort` swapped?"),
        ([Some(StPicture { st: vec![[-1.0; 2]; 210 * 150], ..undistort() }), None], None, "less than a tenth"),
    ] {
        let error = of(maps, size).err().unwrap_or_default();
        assert!(error.contains(problem), "expected {problem}: {error}");
    }
}

#[test]
fn keys_of_a_profile_name_files_beside_it() {
    let read = |text: &str, profile: Option<&Path>| {
        let mut table: toml::Table = text.parse().unwrap();
        resolve(&mut table, profile).map(|()| table)
    };
    let profile = Path::new("folder/camera.toml");
    assert!(read("undistort = \"a.exr\"\nmodel = \"st_map\"\n", None).unwrap().keys().eq(["model"]));
    for (text, problem) in [
        ("undistort = \"none.exr\"\n", "[camera.distortion] undistort: folder/none.exr"),
        ("redistort = 3\n", "redistort must name a file"),
        ("undistorted_width_px = 200\n", "expected both undistorted_width_px and undistorted_height_px"),
        ("undistorted_width_px = 0\nundistorted_height_px = 1\n", "undistorted_width_px = 0; expected 1 to 65536"),
        ("undistorted_width_px = 9\nundistorted_height_px = 9\n", "belongs to `redistort`, which is missing"),
    ] {
        let error = read(text, Some(profile)).unwrap_err();
        assert!(error.contains(problem), "{error}");
    }
    assert!(read("k1 = 0.1\n", Some(profile)).unwrap().contains_key("k1"));
}

#[test]
fn maps_replace_the_coefficients_of_earlier_profiles() {
    let table = of([Some(undistort()), None], None).unwrap();
    let mut entries: toml::Table = "k2 = 0.5\n".parse().unwrap();
    insert(&table.distortion.map.clone().unwrap().unbound(), &mut entries);
    let mut lens = lens().distortion;
    for (name, value) in &entries {
        let value = match value {
            toml::Value::Float(number) => Value::Number(*number),
            other => Value::Text(other.as_str().unwrap().to_owned()),
        };
        lens.set(name, &value).unwrap();
    }
    // A coefficient beside the map is an error.
    assert_eq!(lens.missing(), Some("k2"));
    lens.k2 = 0.0;
    assert_eq!((lens.missing(), Geometry::new(plate_camera(), lens)), (None, table));
}
