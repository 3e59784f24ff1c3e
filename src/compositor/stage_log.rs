//! Which stages of a frame were computed.

use crate::memo::Memo;
use crate::stage::Stage;

/// The stages that were computed for a frame, in order.
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

    /// Logs a stage that retains no result here.
    pub fn run_always(&mut self, stage: Stage) {
        self.0.push(stage);
    }

    pub fn into_stages(self) -> Vec<Stage> {
        self.0
    }
}
