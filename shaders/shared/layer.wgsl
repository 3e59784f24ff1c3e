// The virtual layer: premultiplied linear colour, and the geometry of its nearest sample. Geometry
// texels are four 16-bit words: two for depth (m, a 32-bit float; 0 where there is nothing) and two
// 16-bit floats of velocity (px/s). One texel has both, each as exact as needed.

// A texel as two 32-bit words, depth and velocity, for buffers; and back.
fn words_of(texel: vec4<u32>) -> vec2<u32> {
    return texel.xz | (texel.yw << vec2<u32>(16u));
}

fn texel_of(words: vec2<u32>) -> vec4<u32> {
    return vec4<u32>(words & vec2<u32>(0xffffu), words >> vec2<u32>(16u)).xzyw;
}

// Depth in x, velocity in zw.
fn unpack_geometry(texel: vec4<u32>) -> vec4<f32> {
    let words = words_of(texel);
    return vec4<f32>(bitcast<f32>(words.x), 0.0, unpack2x16float(words.y));
}

fn pack_geometry(depth_m: f32, velocity: vec2<f32>) -> vec4<u32> {
    let v = pack2x16float(clamp(velocity, vec2<f32>(-60000.0), vec2<f32>(60000.0)));
    return texel_of(vec2<u32>(bitcast<u32>(depth_m), v));
}

fn inside_layer(p: vec2<i32>, size: vec2<i32>) -> bool {
    return all(p >= vec2<i32>(0)) && all(p < size);
}

// Premultiplied; zero outside the layer, whose texture is larger.
fn light_within(colors: texture_2d<f32>, p: vec2<i32>, size: vec2<i32>) -> vec4<f32> {
    return select(vec4<f32>(0.0), textureLoad(colors, p, 0), inside_layer(p, size));
}

fn depth_m(geometry: vec4<f32>) -> f32 {
    return geometry.x;
}
