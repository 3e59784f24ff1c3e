// The composite where colours have parted: each goes over the camera's by its own coverage.
@group(0) @binding(4) var chromatic_coverage: texture_2d<f32>;

fn apply_chromatic_aberration(p: vec2<i32>, pixel: Mixed) -> Mixed {
    let q = p + composite.layer.xy;
    // In a photograph there are pixels beside the layer, too.
    let inside = all(q >= vec2<i32>(0)) && all(q < composite.layer.zw);
    let coverage = select(vec3<f32>(0.0), textureLoad(chromatic_coverage, q, 0).rgb, inside);
    return mixed_at(p, layer_at(p).rgb, coverage);
}
