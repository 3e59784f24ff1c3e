// The composite where colours have parted: each goes over the camera's by its own coverage.
@group(0) @binding(4) var chromatic_coverage: texture_2d<f32>;

fn apply_chromatic_aberration(p: vec2<i32>, pixel: Mixed) -> Mixed {
    let coverage = textureLoad(chromatic_coverage, p + composite.layer.xy, 0).rgb;
    return mixed_at(p, layer_at(p).rgb, coverage);
}
