// The ratio of the real light that is left where a share is taken. A share that rounds the ratio to 1 in the layer's file,
// whose 16-bit floats are 2⁻¹¹ apart below 1 and 2⁻¹⁰ above, is none: a pixel is touched only where the file says so.
fn left_of(taken: vec3<f32>) -> vec3<f32> {
    let is_none = (taken <= vec3<f32>(1.0 / 4096.0)) & (taken >= vec3<f32>(-1.0 / 2048.0));
    return select(1.0 - taken, vec3<f32>(1.0), is_none);
}
