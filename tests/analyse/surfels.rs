//! Surfaces fused from all depth maps of a recording.

use image::Luma;

use crate::footage::{analysed_by_tier, demo_by_tier, opened};
use locard::simulate::Flaws;

/// Frames with a hand in front of the camera, and its distance, m.
const WITH_HAND: std::ops::Range<usize> = 3..6;
const HAND_M: f64 = 0.4;
/// Depth codes per metre, as in the demonstration's recording.toml.
const PER_METRE: f64 = 250.0;

// Slow: a recording is analysed.
#[test]
fn hand_in_a_few_frames_is_excluded_from_the_fused_surfaces() {
    let folder = demo_by_tier(12, &Flaws::default(), 4);
    for frame in WITH_HAND {
        let file = folder.path().join(format!("site/depth/{frame:05}.png"));
        let mut depth = image::open(&file).unwrap().into_luma16();
        let (width, height) = depth.dimensions();
        for (x, y) in (height / 4..height / 2).flat_map(|y| (width / 3..2 * width / 3).map(move |x| (x, y))) {
            depth.put_pixel(x, y, Luma([(PER_METRE * HAND_M) as u16]));
        }
        depth.save(&file).unwrap();
    }
    let shot = opened(&folder);
    let analysis = analysed_by_tier(&shot, 2);
    println!("{}", analysis.findings);
    let surfels = analysis.refinement(None).surfels;
    let camera = shot.recording.pose_at_frame(WITH_HAND.start + 1).unwrap();
    let near =
        surfels.iter().filter(|s| (0.0..HAND_M + 0.1).contains(&camera.transform_point(s.position_m.as_dvec3()).z));
    assert!(surfels.len() > 1000 && near.count() == 0, "{} surfels", surfels.len());
    // With the analysis beside the recording, its frames include the surfels.
    analysis.write(&folder.path().join("site.analysis"), &shot.recording).unwrap();
    assert!(shot.read(2).unwrap().surfels.is_empty() && opened(&folder).read(2).unwrap().surfels == surfels);
}
