// Rounded to the nearest 16-bit float. Drivers may truncate instead: a sum of coverages slightly
// below 1 would then let the camera's light through, more with every pass.
fn rounded_to_half(v: vec4<f32>) -> vec4<f32> {
    return bitcast<vec4<f32>>((bitcast<vec4<u32>>(v) + 0x1000u) & vec4<u32>(0xffffe000u));
}
