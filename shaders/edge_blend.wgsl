// Antialiasing against camera pixels (Fischer 2006, antialiasing):
// (current + Σ camera_i) / (n + 1) over the n camera pixels of the 3×3 neighbourhood.
struct EdgeBlend { impact: f32 }
@group(1) @binding(0) var<uniform> edge_blend: EdgeBlend;

// What is covered by half and more is the object's, whatever has softened its edge.
fn is_virtual(p: vec2<i32>) -> bool {
    return layer_at(p).a >= 0.5;
}

fn seen_at(p: vec2<i32>) -> Mixed {
    let light = layer_at(p);
    if all(light == vec4<f32>(0.0)) {
        return camera_at(p);
    }
    return mixed_at(p, light.rgb, coverage_at(p, light.a));
}

fn apply_edge_blend(p: vec2<i32>, current: Mixed) -> Mixed {
    var n = 0.0;
    var sum = vec3<f32>(0.0);
    var variance = vec3<f32>(0.0);
    for (var dy = -1; dy <= 1; dy++) {
        for (var dx = -1; dx <= 1; dx++) {
            let q = p + vec2<i32>(dx, dy);
            if inside_picture(q) && !is_virtual(q) {
                let seen = seen_at(q);
                n += 1.0;
                sum += min(seen.code, vec3<f32>(1.0));
                variance += seen.camera_variance;
            }
        }
    }
    if n == 0.0 || !is_virtual(p) {
        return current;
    }
    let share = edge_blend.impact / (n + 1.0);
    let own = 1.0 - share * n;
    return Mixed(own * min(current.code, vec3<f32>(1.0)) + share * sum, own * own * current.camera_variance + share * share * variance);
}
