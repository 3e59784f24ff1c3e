//! The evidence kit: every item, computed.

mod abfo;
mod arrow;
mod blood;
mod bullet;
mod canvas;
mod cartridge;
mod cases;
mod decal;
mod footprint;
mod glb;
mod glyph;
mod knife;
mod l_scale;
mod marker;
mod noise;
mod phone;
mod revolve;
mod shape;

pub use glb::Prop;

/// A file of the kit and the function that computes it.
pub struct Item {
    /// Path below `scenes/`.
    pub file: String,
    pub make: Box<dyn Fn() -> Prop + Send + Sync>,
}

fn item(file: &str, make: impl Fn() -> Prop + Send + Sync + 'static) -> Item {
    Item { file: file.to_owned(), make: Box::new(make) }
}

/// Every item, in the order of the catalogue.
pub fn items() -> Vec<Item> {
    let mut items: Vec<Item> = (1..=9).map(|n| item(&format!("marker-{n}.glb"), move || marker::numbered(n))).collect();
    items.push(item("l-scale.glb", l_scale::l_scale));
    items.push(item("cartridge-case-9mm.glb", cartridge::cartridge));
    let labels = (10..=20).map(|n| n.to_string()).chain(('A'..='Z').map(|letter| letter.to_string()));
    items.extend(labels.map(|label| item(&format!("kit/marker-{label}.glb"), move || marker::lettered(&label))));
    items.extend([
        item("kit/abfo-no-2.glb", abfo::scale),
        item("kit/arrow.glb", arrow::arrow),
        item("kit/arrow-north.glb", arrow::north),
        item("kit/cartridge-case-22lr.glb", cases::rimfire_22),
        item("kit/cartridge-case-45acp.glb", cases::auto_45),
        item("kit/cartridge-case-223rem.glb", cases::remington_223),
        item("kit/bullet-9mm.glb", bullet::unfired),
        item("kit/bullet-9mm-fired.glb", bullet::fired),
        item("kit/kitchen-knife.glb", knife::knife),
        item("kit/smartphone.glb", phone::phone),
        item("kit/shoe-print-left.glb", || footprint::shoe(false)),
        item("kit/shoe-print-right.glb", || footprint::shoe(true)),
        item("kit/footprint-left.glb", || footprint::bare(false)),
        item("kit/footprint-right.glb", || footprint::bare(true)),
        item("kit/blood-drop.glb", blood::drop),
        item("kit/blood-spatter.glb", blood::spatter),
        item("kit/blood-pool.glb", blood::pool),
    ]);
    items
}
