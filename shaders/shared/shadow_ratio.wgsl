// Shadow ratio from the fraction of light removed. Fractions that the layer's file, with 16-bit floats 2⁻¹¹ apart below 1
// and 2⁻¹⁰ apart above, would round to a ratio of 1 count as none: a pixel is touched only where the file says so.
const LARGEST_UNSEEN_LOSS: f32 = 1.0 / 4096.0;
const LARGEST_UNSEEN_GAIN: f32 = 1.0 / 2048.0;

fn shadow_ratio(removed: vec3<f32>) -> vec3<f32> {
    let is_none = (removed <= vec3<f32>(LARGEST_UNSEEN_LOSS)) & (removed >= vec3<f32>(-LARGEST_UNSEEN_GAIN));
    return select(1.0 - removed, vec3<f32>(1.0), is_none);
}
