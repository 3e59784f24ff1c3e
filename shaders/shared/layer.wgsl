// The virtual layer: premultiplied linear colour, and the geometry of its nearest sample.
// Geometry texels hold depth_m in two 16-bit halves (x + y), velocity in px/s (z, w).

fn depth_m(geometry: vec4<f32>) -> f32 {
    return geometry.x + geometry.y;
}

// Two halves of a depth: the first rounded as a 16-bit float rounds, the second what is left.
fn pack_depth(depth: f32) -> vec2<f32> {
    let high = unpack2x16float(pack2x16float(vec2<f32>(depth, 0.0))).x;
    return vec2<f32>(high, depth - high);
}
