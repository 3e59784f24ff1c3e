// The nearest number of 16 bits. Drivers may cut instead, and what is covered by a sum of shares that is a hair below 1
// would let the camera through, more with every pass.
fn rounded_to_half(v: vec4<f32>) -> vec4<f32> {
    return bitcast<vec4<f32>>((bitcast<vec4<u32>>(v) + 0x1000u) & vec4<u32>(0xffffe000u));
}
