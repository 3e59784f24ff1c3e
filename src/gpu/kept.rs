//! Caches of what is computed from values.

use std::any::{Any, TypeId};
use std::collections::HashMap;

/// The values of each kind that were last used, by what they were made from. A kind is the types of its key and value.
#[derive(Debug, Default)]
pub struct Kept {
    kinds: HashMap<TypeId, Box<dyn Any + Send + Sync>>,
}

/// At most this many of a kind are kept; the least recently used goes first.
pub const MANY: usize = 64;
/// The same for values of several megabytes.
pub const FEW: usize = 4;

impl Kept {
    /// The value of a key. It is made if it is not kept.
    pub fn get<K, V>(&mut self, most: usize, key: K, make: impl FnOnce(&K) -> V) -> V
    where
        K: PartialEq + Send + Sync + 'static,
        V: Clone + Send + Sync + 'static,
    {
        let all = self.kinds.entry(TypeId::of::<(K, V)>()).or_insert_with(|| Box::new(Vec::<(K, V)>::new()));
        // The map's key is this very type, so this always succeeds.
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
        // 2 was used last and is still kept, 1 and 3 are not.
        assert_eq!(kept.get(MANY, 2u32, |_| 0u32), 20);
        assert_eq!(kept.get(MANY, 3u32, |_| 0u32), 0);
    }
}
