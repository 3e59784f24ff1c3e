// A lens as a tensor product of cubic B-splines (camera/lens_map.rs).

// Weights of a cell's four control points of a cubic B-spline.
fn spline_weights(t: f32) -> vec4<f32> {
    let s = 1.0 - t;
    return vec4<f32>(
        s * s * s,
        4.0 + t * t * (3.0 * t - 6.0),
        1.0 + 3.0 * t * (1.0 + t * s),
        t * t * t,
    ) / 6.0;
}

fn spline_slopes(t: f32) -> vec4<f32> {
    let s = 1.0 - t;
    return vec4<f32>(-0.5 * s * s, t * (1.5 * t - 2.0), 0.5 + t * (1.0 - 1.5 * t), 0.5 * t * t);
}

// A lens's table at normalised coordinates, continued along its tangent beyond its domain. `terms`
// are the corner of the domain and the cells per unit.
fn distort_by_table(n: vec2<f32>, table: texture_2d<f32>, terms: vec4<f32>) -> vec2<f32> {
    let place = (n - terms.xy) * terms.zw;
    let cells = vec2<f32>(textureDimensions(table)) - 3.0;
    let inside = clamp(place, vec2<f32>(0.0), cells);
    let cell = min(floor(inside), cells - 1.0);
    let t = inside - cell;
    let across = spline_weights(t.x);
    let across_slope = spline_slopes(t.x);
    let down = spline_weights(t.y);
    let down_slope = spline_slopes(t.y);
    var value = vec2<f32>(0.0);
    var by_x = vec2<f32>(0.0);
    var by_y = vec2<f32>(0.0);
    for (var y = 0; y < 4; y++) {
        var sum = vec2<f32>(0.0);
        var slope = vec2<f32>(0.0);
        for (var x = 0; x < 4; x++) {
            let control = textureLoad(table, vec2<i32>(cell) + vec2<i32>(x, y), 0).xy;
            sum += across[x] * control;
            slope += across_slope[x] * control;
        }
        value += down[y] * sum;
        by_x += down[y] * slope;
        by_y += down_slope[y] * sum;
    }
    let beyond = place - inside;
    return n + value + by_x * beyond.x + by_y * beyond.y;
}
