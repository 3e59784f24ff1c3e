//! Converts glTF materials and textures.

use super::picture::{self, MAX_PIXELS, Rgba};
use super::reader::ModelReader;
use super::schema::{self, TextureInfo};
use super::{Alpha, Material, SceneError, SceneTexture, TextureUse, Wrap, bytes};

impl ModelReader<'_> {
    /// Index of a material in the scene, loaded on first use. `None` is glTF's default.
    pub(super) fn material(&mut self, index: Option<usize>, location: &str) -> Result<usize, SceneError> {
        if let Some(&material) = self.materials.get(&index) {
            return Ok(material);
        }
        let material = match index {
            None => Material::default(),
            Some(i) => {
                let gltf = self.gltf;
                let json = gltf.get(&gltf.json.materials, "materials", i, location)?;
                self.read_material(json, &format!("materials[{i}]"))?
            }
        };
        self.loader.scene.materials.push(material);
        let added = self.loader.scene.materials.len() - 1;
        self.materials.insert(index, added);
        Ok(added)
    }

    fn read_material(&mut self, json: &schema::MaterialJson, location: &str) -> Result<Material, SceneError> {
        let pbr = &json.pbr_metallic_roughness;
        let place = |key: &str| format!("{location}.{key}");
        let pbr_place = |key: &str| format!("{location}.pbrMetallicRoughness.{key}");
        let strength = json.extensions.emissive_strength.as_ref().and_then(|e| e.emissive_strength).unwrap_or(1.0);
        let strength = self.factor(strength, f32::MAX, &place("extensions.KHR_materials_emissive_strength"))?;
        let mut base_color = pbr.base_color_factor.unwrap_or([1.0; 4]);
        for channel in &mut base_color {
            *channel = self.factor(*channel, 1.0, &pbr_place("baseColorFactor"))?;
        }
        let mut emissive = json.emissive_factor.unwrap_or([0.0; 3]);
        for channel in &mut emissive {
            *channel = self.factor(*channel, 1.0, &place("emissiveFactor"))? * strength;
        }
        let normal_scale = json.normal_texture.as_ref().and_then(|t| t.scale).unwrap_or(1.0);
        if !normal_scale.is_finite() {
            return Err(self.gltf.bad(place("normalTexture.scale"), normal_scale, "a finite number"));
        }
        let occlusion = json.occlusion_texture.as_ref().and_then(|t| t.strength).unwrap_or(1.0);
        Ok(Material {
            name: json.name.clone().unwrap_or_else(|| location.to_owned()),
            base_color,
            metallic: self.factor(pbr.metallic_factor.unwrap_or(1.0), 1.0, &pbr_place("metallicFactor"))?,
            roughness: self.factor(pbr.roughness_factor.unwrap_or(1.0), 1.0, &pbr_place("roughnessFactor"))?,
            emissive,
            normal_scale,
            occlusion_strength: self.factor(occlusion, 1.0, &place("occlusionTexture.strength"))?,
            alpha: self.alpha(json, location)?,
            double_sided: json.double_sided,
            unlit: json.extensions.unlit.is_some(),
            base_color_texture: self.texture(&pbr.base_color_texture, true, &pbr_place("baseColorTexture"))?,
            metallic_roughness_texture: self.texture(
                &pbr.metallic_roughness_texture,
                false,
                &pbr_place("metallicRoughnessTexture"),
            )?,
            normal_texture: self.texture(&json.normal_texture, false, &place("normalTexture"))?,
            occlusion_texture: self.texture(&json.occlusion_texture, false, &place("occlusionTexture"))?,
            emissive_texture: self.texture(&json.emissive_texture, true, &place("emissiveTexture"))?,
        })
    }

    /// A factor from 0 to `max`. Outside values are clamped with a warning.
    fn factor(&mut self, value: f32, max: f32, location: &str) -> Result<f32, SceneError> {
        if !value.is_finite() {
            return Err(self.gltf.bad(location, value, "a finite number"));
        }
        let clamped = value.clamp(0.0, max);
        if clamped != value {
            self.warn(format!("{location} is {value}, outside 0 to {max}: {clamped} is used"));
        }
        Ok(clamped)
    }

    fn alpha(&mut self, json: &schema::MaterialJson, location: &str) -> Result<Alpha, SceneError> {
        match json.alpha_mode.as_deref() {
            None | Some("OPAQUE") => Ok(Alpha::Opaque),
            Some("BLEND") => Ok(Alpha::Blend),
            Some("MASK") => {
                let cutoff = json.alpha_cutoff.unwrap_or(0.5);
                // A cutoff above 1 removes everything, as specified by the file.
                Ok(Alpha::Mask(self.factor(cutoff, f32::MAX, &format!("{location}.alphaCutoff"))?))
            }
            Some(other) => {
                self.warn(format!("{location}.alphaMode is {other:?}, none of OPAQUE, MASK and BLEND: OPAQUE is used"));
                Ok(Alpha::Opaque)
            }
        }
    }

    fn texture(
        &mut self,
        info: &Option<TextureInfo>,
        srgb: bool,
        location: &str,
    ) -> Result<Option<TextureUse>, SceneError> {
        let Some(info) = info else { return Ok(None) };
        let gltf = self.gltf;
        let place = format!("textures[{}]", info.index);
        let texture = gltf.get(&gltf.json.textures, "textures", info.index, format!("{location}.index"))?;
        let Some(image) = texture.source else {
            gltf.only_in_extension(&place, &texture.extensions, "a source that is PNG or JPEG")?;
            self.warn(format!("{place} has no source: ignored"));
            return Ok(None);
        };
        let transform = info.extensions.transform.as_ref();
        let uv_set = transform.and_then(|t| t.tex_coord).unwrap_or(info.tex_coord);
        if uv_set > 1 {
            self.warn(format!("{location} uses TEXCOORD_{uv_set}, only TEXCOORD_0 and _1 are supported: ignored"));
            return Ok(None);
        }
        let rows = transform.map_or([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], transform_rows);
        if !rows.as_flattened().iter().all(|v| v.is_finite()) {
            let location = format!("{location}.extensions.KHR_texture_transform");
            return Err(gltf.bad(location, "a number that is not finite", "finite numbers"));
        }
        let default = schema::Sampler::default();
        let sampler = match texture.sampler {
            Some(i) => gltf.get(&gltf.json.samplers, "samplers", i, format!("{place}.sampler"))?,
            None => &default,
        };
        let (wrap, smooth, mipmaps) = self.sampling(sampler, &format!("{place}.sampler"));
        let key = (image, srgb, wrap, smooth, mipmaps);
        let texture = match self.textures.get(&key) {
            Some(&index) => index,
            None => {
                let Rgba { width, height, rgba } = self.image(image, &format!("{place}.source"))?;
                self.loader.scene.textures.push(SceneTexture { width, height, rgba, srgb, wrap, smooth, mipmaps });
                let added = self.loader.scene.textures.len() - 1;
                self.textures.insert(key, added);
                added
            }
        };
        Ok(Some(TextureUse { texture, uv_set, transform: rows }))
    }

    /// Wrap modes, smooth magnification, and mipmapped minification. An unknown code is replaced by
    /// the default, with a warning.
    fn sampling(&mut self, sampler: &schema::Sampler, location: &str) -> ([Wrap; 2], bool, bool) {
        let mut valid_code = |key: &str, code: Option<u32>, codes: &[u32]| {
            let code = code?;
            if codes.contains(&code) {
                return Some(code);
            }
            let codes: Vec<_> = codes.iter().map(u32::to_string).collect();
            self.warn(format!("{location}.{key} is {code}, none of {}: the default is used", codes.join(", ")));
            None
        };
        let mut wrap = |key, code| match valid_code(key, code, &[10497, 33071, 33648]) {
            Some(33648) => Wrap::Mirror,
            Some(33071) => Wrap::Clamp,
            _ => Wrap::Repeat,
        };
        let wraps = [wrap("wrapS", sampler.wrap_s), wrap("wrapT", sampler.wrap_t)];
        let smooth = valid_code("magFilter", sampler.mag_filter, &[9728, 9729]) != Some(9728);
        let codes = [9728, 9729, 9984, 9985, 9986, 9987];
        let mipmaps = !matches!(valid_code("minFilter", sampler.min_filter, &codes), Some(9728 | 9729));
        (wraps, smooth, mipmaps)
    }

    fn image(&mut self, index: usize, location: &str) -> Result<Rgba, SceneError> {
        if let Some(image) = self.images.get(&index) {
            return Ok(image.clone());
        }
        let gltf = self.gltf;
        let image = gltf.get(&gltf.json.images, "images", index, location)?;
        let location = format!("images[{index}]");
        let outside;
        let bytes = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => {
                outside = bytes::resolve(&gltf.file, &format!("{location}.uri"), uri)?;
                &outside[..]
            }
            (None, Some(view)) => gltf.view(view, &format!("{location}.bufferView"))?.0,
            (None, None) => return Err(gltf.bad(location, "neither a uri nor a bufferView", "one of them")),
        };
        let decoded = picture::decode(&gltf.file, &location, bytes, MAX_PIXELS - self.loader.pixels)?;
        self.loader.pixels += u64::from(decoded.width) * u64::from(decoded.height);
        self.images.insert(index, decoded.clone());
        Ok(decoded)
    }
}

/// Offset · rotation · scale as two rows (KHR_texture_transform, "Overview"). The rotation is
/// counter-clockwise in the picture, whose v points down: u' = cos·u + sin·v.
fn transform_rows(t: &schema::TextureTransform) -> [[f32; 3]; 2] {
    let [x, y] = t.offset.unwrap_or([0.0; 2]);
    let [scale_u, scale_v] = t.scale.unwrap_or([1.0; 2]);
    let (sin, cos) = t.rotation.unwrap_or(0.0).sin_cos();
    [[cos * scale_u, sin * scale_v, x], [-sin * scale_u, cos * scale_v, y]]
}
