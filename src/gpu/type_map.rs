//! Type map: one value of each type, shared by all clones.

use std::any::{Any, TypeId};
use std::collections::HashMap;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

/// Values by their types. No memo: it holds the device's memos, one of each type.
#[derive(Clone, Default)]
pub struct TypeMap(Arc<Mutex<HashMap<TypeId, Arc<dyn Any + Send + Sync>>>>);

impl TypeMap {
    /// `make` must not access the map.
    pub fn get<T: Send + Sync + 'static>(&self, make: impl FnOnce() -> T) -> Arc<T> {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let one = all.entry(TypeId::of::<T>()).or_insert_with(|| Arc::new(make()));
        one.clone().downcast().unwrap_or_else(|_| unreachable!("a value of its own type"))
    }

    /// Clears the map: values created during a failure may be unusable. Existing references stay
    /// valid.
    pub fn clear(&self) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }
}

impl fmt::Debug for TypeMap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("TypeMap")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_type_is_created_once_and_shared_by_clones() {
        let shared = TypeMap::default();
        let first = shared.get(|| 1u32);
        assert_eq!((*first, *shared.clone().get(|| 2u32), *shared.get(|| 'a')), (1, 1, 'a'));
        assert_eq!(*TypeMap::default().get(|| 3u32), 3);
        shared.clear();
        assert_eq!((*first, *shared.get(|| 4u32)), (1, 4));
    }
}
