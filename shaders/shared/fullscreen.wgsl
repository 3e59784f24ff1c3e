// A corner of a rectangle (x0, y0, x1, y1) of a target, for a strip of four vertices.
fn corner_of(rect: vec4<i32>, vertex: u32, target_size: vec2<f32>) -> vec4<f32> {
    let at = select(rect.xy, rect.zw, vec2<bool>((vertex & 1u) == 1u, (vertex >> 1u) == 1u));
    return vec4<f32>(vec2<f32>(at) / target_size * vec2<f32>(2.0, -2.0) + vec2<f32>(-1.0, 1.0), 0.0, 1.0);
}

// One triangle that covers the viewport.
@vertex
fn fullscreen_vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    let corner = vec2<f32>(f32((index << 1u) & 2u), f32(index & 2u));
    return vec4<f32>(corner * 2.0 - 1.0, 0.0, 1.0);
}
