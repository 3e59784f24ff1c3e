//! Which stages of a frame were computed.

use std::ops::Deref;
use std::sync::Arc;

use crate::memo::Memo;
use crate::stage::Stage;

/// The stages that a frame needs, of those that may be retained.
#[derive(Debug, Default)]
pub struct StageLog(Vec<Stage>);

impl StageLog {
    /// The result of a stage: the retained one of an equal key, or a new one. Without a key, it is
    /// neither looked up nor retained.
    pub fn run<K: PartialEq, V: Clone>(
        &mut self,
        stage: Stage,
        retained: &Memo<K, V>,
        key: Option<K>,
        compute: impl FnOnce() -> V,
    ) -> V {
        if let Some(value) = key.as_ref().and_then(|key| retained.get(key)) {
            return value;
        }
        self.0.push(stage);
        let value = compute();
        key.map_or(value.clone(), |key| retained.insert(key, value))
    }

    /// Logs a stage whose result is not retained.
    pub fn run_always(&mut self, stage: Stage) {
        self.0.push(stage);
    }

    pub fn into_stages(self) -> Vec<Stage> {
        self.0
    }
}

/// A value that is compared by its address.
#[derive(Debug)]
pub struct ByAddress<T: ?Sized>(pub Arc<T>);

impl<T: ?Sized> PartialEq for ByAddress<T> {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl<T: ?Sized> Deref for ByAddress<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.0
    }
}
