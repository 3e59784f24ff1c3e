//! Pictures are made on threads of their own, so that the window never waits: one thread decodes, plans and records,
//! another waits for the GPU. Two pictures may be under way, one drawn while the next is recorded.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use super::reader::Reader;
use locard_engine::compositor::{Compositor, FrameStats, Pending, Target};
use locard_engine::frame::Frame;
use locard_engine::gpu::{Gpu, GpuError, PartTime, read_back};
use locard_engine::pixels::Pixels;
use locard_engine::scene::Scene;
use locard_engine::shot::{Reduced, Shot, ShotError};

/// Holds code values, which is what the window takes a texture's texels for.
pub const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// What a picture is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Made {
    pub frame: usize,
    /// The project's ([`Project::version`](super::Project::version)), or that of what it is compared with.
    pub version: u64,
    /// Whether it is what it is compared with.
    pub is_other: bool,
    /// It is made smaller by this factor, so that it comes soon; 1 for the picture itself.
    pub by: u32,
    /// Its shadows and real edges may be rough, so that it comes soon; of one that is shown, whether they are.
    pub is_rough: bool,
}

impl Made {
    /// Whether both show the same, be it at another size or rough.
    pub fn shows_as(&self, other: &Self) -> bool {
        let whole = |made: &Self| Self { by: 1, is_rough: false, ..*made };
        whole(self) == whole(other)
    }

    /// Whether it came soon instead of as it is.
    pub fn is_hasty(&self) -> bool {
        self.by > 1 || self.is_rough
    }
}

/// A picture to be made.
#[derive(Debug)]
pub struct Order {
    pub made: Made,
    /// As all is set at this moment.
    pub shot: Shot,
    /// The frame, where it is a camera's; else the recording's is decoded.
    pub given: Option<Arc<Frame>>,
    /// Where it goes: of the picture's size.
    pub texture: wgpu::Texture,
    pub wants: Wants,
}

/// What shall come with a picture.
#[derive(Clone, Copy, Debug, Default)]
pub struct Wants {
    /// Its code values.
    pub codes: bool,
    /// The GPU's time for its parts.
    pub times: bool,
}

/// A picture that is made, or why it is not.
#[derive(Debug)]
pub struct Finished {
    pub made: Made,
    /// `None` where it could not be decoded.
    pub frame: Option<Arc<Frame>>,
    pub picture: Result<Picture, ShotError>,
    /// From when it was taken up.
    pub took: Duration,
}

#[derive(Debug)]
pub struct Picture {
    pub stats: FrameStats,
    /// Whether its shadows or real edges are.
    pub is_rough: bool,
    /// 8 bits each, as they are shown.
    pub codes: Option<Arc<Pixels>>,
    /// Empty where nobody wanted them, or the device has no clock.
    pub times: Vec<PartTime>,
}

/// Makes pictures in the order in which they are asked for.
#[derive(Debug)]
pub struct Maker {
    orders: Option<Sender<Order>>,
    finished: Receiver<Finished>,
    threads: Vec<JoinHandle<()>>,
    under_way: usize,
}

impl Maker {
    /// `wake` is called from a thread whenever a picture is finished.
    pub fn new(gpu: &Gpu, wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let (orders, to_make) = channel::<Order>();
        let (begun, to_await) = channel::<(Order, Instant, Option<Arc<Frame>>, Result<Pending, ShotError>)>();
        let (done, finished) = channel();
        let of_maker = gpu.clone();
        let maker = Builder::new().name("window maker".to_owned()).spawn(move || {
            let Ok(first) = to_make.recv() else { return };
            let mut scene = Arc::clone(&first.shot.scene);
            let mut compositor = first.shot.compositor(of_maker.clone());
            let mut reader = Reader::new(Arc::clone(&first.shot.recording));
            // The frame of which many pictures are made one after another.
            let mut reduced: Option<(Arc<Frame>, Reduced)> = None;
            for order in std::iter::once(first).chain(to_make) {
                let taken_up = Instant::now();
                if !Arc::ptr_eq(&scene, &order.shot.scene) {
                    scene = Arc::clone(&order.shot.scene);
                    compositor.set_scene(Scene::clone(&scene));
                }
                let view = order.texture.create_view(&Default::default());
                let target = Target::View(&view, FORMAT);
                if order.wants.times {
                    compositor.time_next();
                }
                if order.made.is_rough {
                    compositor.may_be_rough();
                }
                if !reader.is_of(&order.shot.recording) {
                    reader = Reader::new(Arc::clone(&order.shot.recording));
                }
                let frame = order.given.clone().map_or_else(|| reader.frame(order.made.frame, order.made.is_rough), Ok);
                let (frame, pending) = match frame {
                    Ok(frame) => {
                        let submit = || {
                            if order.made.by > 1 {
                                return of_reduced(&order, &frame, &mut reduced, &mut compositor, target);
                            }
                            order.shot.geometry_at(frame.index).and_then(|geometry| {
                                order.shot.submit(&mut compositor, Frame::clone(&frame), &geometry, target, false)
                            })
                        };
                        let failed = |source| ShotError::Gpu { frame: order.made.frame, source };
                        let pending = of_maker.apart(submit).map_err(failed).and_then(|pending| pending);
                        (Some(frame), pending)
                    }
                    Err(error) => (None, Err(error.into())),
                };
                if begun.send((order, taken_up, frame, pending)).is_err() {
                    return;
                }
            }
        })?;
        let of_waiter = gpu.clone();
        let waiter = Builder::new().name("window waiter".to_owned()).spawn(move || {
            for (order, taken_up, frame, pending) in to_await {
                let picture = pending.and_then(|pending| {
                    let failed = |source| ShotError::Gpu { frame: order.made.frame, source };
                    of_waiter
                        .apart(|| await_picture(&of_waiter, &order, &pending))
                        .and_then(|done| done)
                        .map_err(failed)
                });
                let made = order.made;
                let took = taken_up.elapsed();
                if done.send(Finished { made, frame, picture, took }).is_err() {
                    return;
                }
                wake();
            }
        })?;
        Ok(Self { orders: Some(orders), finished, threads: vec![maker, waiter], under_way: 0 })
    }

    /// How many pictures are not finished.
    pub fn under_way(&self) -> usize {
        self.under_way
    }

    /// Begins a picture. Its texture is not to be shown until it is finished.
    pub fn make(&mut self, order: Order) {
        // A thread that is gone makes nothing; `take` tells of it.
        if self.orders.as_ref().is_some_and(|orders| orders.send(order).is_ok()) {
            self.under_way += 1;
        }
    }

    /// The next picture that is finished; `Err` where nothing more will come.
    pub fn take(&mut self) -> Result<Option<Finished>, ()> {
        match self.finished.try_recv() {
            Ok(finished) => {
                self.under_way -= 1;
                Ok(Some(finished))
            }
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(()),
        }
    }
}

/// Of the frame at a fraction of its size, which is kept: many pictures are made of one while something is dragged.
fn of_reduced(
    order: &Order,
    frame: &Arc<Frame>,
    kept: &mut Option<(Arc<Frame>, Reduced)>,
    compositor: &mut Compositor,
    target: Target<'_>,
) -> Result<Pending, ShotError> {
    let is_of = |(of, reduced): &(Arc<Frame>, Reduced)| Arc::ptr_eq(of, frame) && reduced.by() == order.made.by;
    let kept = match kept.take().filter(is_of) {
        Some(same) => kept.insert(same),
        None => kept.insert((Arc::clone(frame), Reduced::new(frame, order.made.by))),
    };
    order.shot.submit_reduced(compositor, &kept.1, target)
}

fn await_picture(gpu: &Gpu, order: &Order, pending: &Pending) -> Result<Picture, GpuError> {
    pending.await_drawn(gpu)?;
    gpu.check()?;
    let codes = match order.wants.codes && order.made.by == 1 {
        true => {
            let texels = read_back(gpu, &order.texture)?;
            let codes = texels.chunks_exact(4).flat_map(|texel| [texel[0], texel[1], texel[2]]).collect();
            Pixels::from_u8(order.texture.width(), order.texture.height(), codes).map(Arc::new)
        }
        false => None,
    };
    let is_rough = pending.is_rough();
    Ok(Picture { stats: pending.stats().clone(), is_rough, codes, times: pending.times(gpu)? })
}

impl Drop for Maker {
    fn drop(&mut self) {
        drop(self.orders.take());
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}
