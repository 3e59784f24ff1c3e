//! Mean albedo of triangles, textures included.
//!
//! Not modelled: directional reflection. Glossy surfaces count as matt ones of the same colour.

use glam::{Vec2, Vec3, Vec4};

use crate::scene::{Material, Mesh, Scene, SceneTexture, TextureUse, Wrap};

/// Barycentric coordinates of the texture samples in a triangle: weights of the second and the
/// third vertex.
const SAMPLE_BARYCENTRICS: [Vec2; 7] = [
    Vec2::new(0.333, 0.333),
    Vec2::new(0.1, 0.1),
    Vec2::new(0.8, 0.1),
    Vec2::new(0.1, 0.8),
    Vec2::new(0.45, 0.1),
    Vec2::new(0.1, 0.45),
    Vec2::new(0.45, 0.45),
];

/// Albedo of a mesh.
#[derive(Debug)]
pub struct MeshAlbedo<'a> {
    mesh: &'a Mesh,
    base: Vec3,
    texture: Option<(&'a SceneTexture, TextureUse)>,
}

impl<'a> MeshAlbedo<'a> {
    pub fn of(scene: &'a Scene, mesh: &'a Mesh) -> Self {
        let default = Material::default();
        let material = scene.materials.get(mesh.material).unwrap_or(&default);
        let texture = material.base_color_texture.and_then(|used| Some((scene.textures.get(used.texture)?, used)));
        Self { mesh, base: Vec4::from(material.base_color).truncate(), texture }
    }

    /// The mean colour of a triangle, given by its vertices, linear.
    pub fn color(&self, corners: [u32; 3]) -> Vec3 {
        let [a, b, c] = corners.map(|i| &self.mesh.vertices[i as usize]);
        let vertex_color = [a, b, c].map(|v| Vec4::from(v.color).truncate()).iter().sum::<Vec3>() / 3.0;
        let Some((texture, used)) = self.texture else { return self.base * vertex_color };
        let uv = [a, b, c].map(|v| Vec2::from(if used.uv_set == 0 { v.uv0 } else { v.uv1 }));
        let at = |place: &Vec2| {
            let uv = uv[0] + place.x * (uv[1] - uv[0]) + place.y * (uv[2] - uv[0]);
            texel(texture, Vec2::from(used.transform.map(|row| Vec3::from(row).dot(uv.extend(1.0)))))
        };
        self.base * vertex_color * SAMPLE_BARYCENTRICS.iter().map(at).sum::<Vec3>() / SAMPLE_BARYCENTRICS.len() as f32
    }
}

/// The nearest texel, linear.
fn texel(texture: &SceneTexture, uv: Vec2) -> Vec3 {
    let texel_index = |at: f32, side: u32, wrap: Wrap| {
        let at = match wrap {
            Wrap::Repeat => at - at.floor(),
            Wrap::Mirror => 1.0 - (at.rem_euclid(2.0) - 1.0).abs(),
            Wrap::Clamp => at,
        };
        ((at * side as f32).max(0.0) as u32).min(side.saturating_sub(1))
    };
    let (x, y) =
        (texel_index(uv.x, texture.width, texture.wrap[0]), texel_index(uv.y, texture.height, texture.wrap[1]));
    let start = 4 * (y as usize * texture.width as usize + x as usize);
    let Some(rgba) = texture.rgba.get(start..start + 3) else { return Vec3::ONE };
    Vec3::new(texture.linear(rgba[0]), texture.linear(rgba[1]), texture.linear(rgba[2]))
}
