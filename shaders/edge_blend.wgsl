// Antialiasing against camera pixels (Fischer 2006, antialiasing; src/effects/edge_blend.rs):
// (current + Σ w_i camera_i) / (Σ w_i + 1) over the 3×3 neighbourhood; w_i is the camera's share of a neighbour.
struct EdgeBlend { impact: f32 }
@group(1) @binding(0) var<uniform> edge_blend: EdgeBlend;

fn apply_edge_blend(p: vec2<i32>, current: Mixed) -> Mixed {
    var n = 0.0;
    var sum = vec3<f32>(0.0);
    var variance = vec3<f32>(0.0);
    for (var i = 0; i < 9; i++) {
        let q = p + vec2<i32>(i % 3 - 1, i / 3 - 1);
        let w = 1.0 - layer_at(q).a;
        if i != 4 && inside_picture(q) && w > 0.0 {
            let camera = camera_at(q);
            n += w;
            sum += w * min(camera.code, vec3<f32>(1.0));
            variance += w * w * camera.camera_variance;
        }
    }
    // The camera's own pixels stay as they are; in a photograph the function is called for them too.
    let covered = layer_at(p).a;
    if n == 0.0 || covered == 0.0 {
        return current;
    }
    let share = edge_blend.impact * covered / (n + 1.0);
    let own = 1.0 - share * n;
    return Mixed(own * min(current.code, vec3<f32>(1.0)) + share * sum, own * own * current.camera_variance + share * share * variance);
}
