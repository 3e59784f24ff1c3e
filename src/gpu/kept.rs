//! What is worked out from values and kept for as long as they are asked for.

use std::any::{Any, TypeId};
use std::collections::HashMap;

/// The last of each kind that were made, by what they were made of. A kind is the type of its key.
#[derive(Debug, Default)]
pub struct Kept {
    kinds: HashMap<TypeId, Box<dyn Any + Send + Sync>>,
}

/// Of a kind no more are kept: those asked for least lately go.
pub const MANY: usize = 64;
/// The same for what takes megabytes.
pub const FEW: usize = 4;

impl Kept {
    /// What belongs to a key; made where it is not known.
    pub fn get<K, V>(&mut self, most: usize, key: K, make: impl FnOnce(&K) -> V) -> V
    where
        K: PartialEq + Send + Sync + 'static,
        V: Clone + Send + Sync + 'static,
    {
        let all = self.kinds.entry(TypeId::of::<(K, V)>()).or_insert_with(|| Box::new(Vec::<(K, V)>::new()));
        // The type is its key's: it cannot be another.
        let Some(all) = all.downcast_mut::<Vec<(K, V)>>() else { return make(&key) };
        match all.iter().position(|(of, _)| *of == key) {
            Some(i) => {
                let found = all.remove(i);
                all.push(found);
            }
            None => {
                let made = make(&key);
                if all.len() == most {
                    all.remove(0);
                }
                all.push((key, made));
            }
        }
        all[all.len() - 1].1.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_is_made_once_and_the_oldest_goes() {
        let mut kept = Kept::default();
        let mut made = Vec::new();
        for key in [1u32, 2, 1, 3, 2] {
            assert_eq!(
                kept.get(MANY, key, |k| {
                    made.push(*k);
                    10 * k
                }),
                10 * key
            );
        }
        assert_eq!(made, [1, 2, 3]);
        // Another type is another kind.
        assert_eq!(kept.get(MANY, 1u64, |_| 7u32), 7);
        for key in 100..100 + MANY as u32 - 1 {
            kept.get(MANY, key, |k| 10 * k);
        }
        // 2 was asked for last and is still there, 1 and 3 are not.
        assert_eq!(kept.get(MANY, 2u32, |_| 0u32), 20);
        assert_eq!(kept.get(MANY, 3u32, |_| 0u32), 0);
    }
}
