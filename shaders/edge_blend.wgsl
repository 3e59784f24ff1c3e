// Antialiasing against camera pixels (Fischer 2006, antialiasing; src/effects/edge_blend.rs): the
// mean of the paper's rule, (current + Σ camera_i) / (n + 1), over the levels of the pixel's own
// coverage. At a level the camera's neighbours are those that are covered less.
struct EdgeBlend { impact: f32 }
@group(1) @binding(0) var<uniform> edge_blend: EdgeBlend;

fn apply_edge_blend(p: vec2<i32>, current: Mixed) -> Mixed {
    let covered = layer_at(p).a;
    // The neighbours that are covered less. The camera's own pixels have none.
    var n = 0;
    var levels: array<f32, 8>;
    var cameras: array<Mixed, 8>;
    for (var i = 0; i < 9; i++) {
        let q = p + vec2<i32>(i % 3 - 1, i / 3 - 1);
        let a = layer_at(q).a;
        if i != 4 && inside_picture(q) && a < covered {
            levels[n] = a;
            cameras[n] = camera_at(q);
            n++;
        }
    }
    if n == 0 {
        return current;
    }
    var own = 1.0;
    var blended = vec3<f32>(0.0);
    var shares: array<f32, 8>;
    for (var i = 0; i < n; i++) {
        // From this neighbour's coverage to the next larger one the same neighbours are the
        // camera's.
        let level = levels[i];
        var next = covered;
        var count = 0.0;
        var sum = vec3<f32>(0.0);
        var is_first = true;
        for (var j = 0; j < n; j++) {
            if levels[j] > level {
                next = min(next, levels[j]);
            } else {
                count += 1.0;
                sum += min(cameras[j].code, vec3<f32>(1.0));
                is_first = is_first && (levels[j] < level || j >= i);
            }
        }
        if is_first {
            let share = edge_blend.impact * composite.opacity * ((next - level) / covered) / (count + 1.0);
            own -= share * count;
            blended += share * sum;
            for (var j = 0; j < n; j++) {
                shares[j] += select(0.0, share, levels[j] <= level);
            }
        }
    }
    var variance = own * own * current.camera_variance;
    for (var j = 0; j < n; j++) {
        variance += shares[j] * shares[j] * cameras[j].camera_variance;
    }
    let code = own * min(current.code, vec3<f32>(1.0)) + blended;
    return Mixed(code, variance, own * current.virtual_share);
}
