// White normal noise at lattice points, in integers: a hash of (seed, frame, lattice point,
// channel) through a table of the normal distribution.
// @import shared/fullscreen
// @import shared/hash
struct White {
    key: vec4<u32>,     // offset of this frame's pattern in the hash's domain
    origin: vec2<i32>,  // the lattice point of the first texel
}
@group(0) @binding(0) var<uniform> white: White;
// 4096 quantiles of the normal distribution, 64 × 64, in units of σ/4096.
@group(0) @binding(1) var normal_table: texture_2d<i32>;

@fragment
fn main(@builtin(position) at: vec4<f32>) -> @location(0) vec4<i32> {
    let lattice = bitcast<vec2<u32>>(vec2<i32>(at.xy) + white.origin);
    let h = pcg3d(vec3<u32>(lattice, 0u) + white.key.xyz) >> vec3<u32>(20u);
    return vec4<i32>(
        textureLoad(normal_table, vec2<u32>(h.x & 63u, h.x >> 6u), 0).x,
        textureLoad(normal_table, vec2<u32>(h.y & 63u, h.y >> 6u), 0).x,
        textureLoad(normal_table, vec2<u32>(h.z & 63u, h.z >> 6u), 0).x,
        0,
    );
}
