//! The steps of a frame: what each of its dispatches does, worked out before anything is recorded.

use crate::pass::layout::{PointLight, Step};
use crate::pass::shade::Chunk;
use crate::pass::sort::SortSteps;
use crate::pass::trace::EyeSteps;
use crate::plan::{EyePlan, LightPlan, StepTable, trace_steps};
use crate::settings::{ClusterOrder, Settings};

/// Indices into the step table.
pub(super) struct Steps {
    /// For j = 1, 2, ...: tracing rounds of the particles that make the j-th reflection, and the reflection.
    pub(super) walk: Vec<(Vec<u32>, u32)>,
    pub(super) eye_trace: EyeSteps,
    /// For each step of the eye paths.
    pub(super) eye_paths: Vec<u32>,
    /// Receivers of second components.
    pub(super) second: u32,
    /// Rounds of every list of rays.
    pub(super) list_trace: Vec<u32>,
    /// For a list that was just filled.
    pub(super) list: u32,
    pub(super) sort: SortSteps,
    /// What the eye sees is put in clusters by its pixels.
    pub(super) by_screen: bool,
    pub(super) bounces: Vec<BounceSteps>,
}

pub(super) struct BounceSteps {
    /// Of the gather rays that leave the bounce before.
    pub(super) gather: u32,
    /// Of receivers and their collection.
    pub(super) receivers: u32,
    /// Chunks of the lights that light them, each in rounds.
    pub(super) shade: Vec<Chunk>,
}

impl Steps {
    /// Adds the steps to the table. `delta` are the lights lit once in each pass.
    pub(super) fn new(
        table: &mut StepTable,
        settings: &Settings,
        plan: &LightPlan,
        delta: &[PointLight],
        lanes: Option<u32>,
        eye: &EyePlan,
    ) -> Steps {
        let pixels = eye.pixels;
        let rounds = settings.rounds;
        let trace = Step { steps: trace_steps(settings.loop_budget), ..Step::default() };
        let walk = (1..plan.survivors.len())
            .map(|j| {
                // Ray j starts at every particle that has made j - 1 reflections and survives the next.
                let rays = table.add_rounds(rounds, Step { end: plan.survivors[j] * settings.classes(), ..trace });
                (rays, table.add(Step { bounce: j as u32, ..Step::default() }))
            })
            .collect();
        let lanes_in_use = Chunk::lanes(settings, lanes);
        let chunk_size = Chunk::size(settings, lanes_in_use.is_some());
        let (depth, sorts) = (settings.max_depth, lanes.is_some());
        let bounces = if settings.compensation && settings.clips() { depth } else { 1 };
        // What gathers light wants a list without gaps.
        // The rays of gathered and of mirrored light take lists without gaps.
        let by_screen = settings.mirror_lights == 0
            && settings.cluster_order == ClusterOrder::Screen
            && sorts
            && bounces == 1
            && depth > 1;
        let shade = |table: &mut StepTable, (first, end): (u32, u32)| {
            // Parallel light comes from no place.
            let mut places = delta.iter().take(end as usize).skip(first as usize);
            let parallel = places.any(|l| l.flags() & PointLight::DIRECTIONAL != 0);
            Chunk::new(table, settings, (first, end), lanes_in_use.filter(|_| !parallel), by_screen)
        };
        let bounces: Vec<BounceSteps> = (0..bounces)
            .map(|bounce| {
                // Eye segment, `bounce` gather rays, shadow ray and j reflections are bounce + j + 2 segments.
                let reflections = (depth as usize).checked_sub(bounce as usize + 2);
                let chunks = reflections.map_or(Vec::new(), |j| plan.chunks(chunk_size, j));
                BounceSteps {
                    gather: table.add(Step { bounce: bounce.max(1) - 1, indirect: 1, ..Step::default() }),
                    receivers: table.add(Step {
                        bounce,
                        end: pixels,
                        indirect: u32::from(bounce > 0),
                        last: u32::from(bounce + 1 == depth),
                        fresh: if by_screen { 2 } else { u32::from(sorts && !chunks.is_empty()) },
                        ..Step::default()
                    }),
                    shade: chunks.into_iter().map(|chunk| shade(table, chunk)).collect(),
                }
            })
            .collect();
        Steps {
            walk,
            eye_trace: EyeSteps::new(table, settings, pixels, lanes_in_use),
            eye_paths: (0..eye.steps)
                .map(|bounce| {
                    let first = if bounce == 0 { eye.twins() } else { 0 };
                    table.add(Step { first, bounce, indirect: u32::from(bounce > 0), ..Step::default() })
                })
                .collect(),
            second: table.add(Step { first: eye.twins(), ..table.steps[bounces[0].receivers as usize] }),
            list_trace: table.add_rounds(rounds, Step { indirect: 1, ..trace }),
            list: table.add(Step { indirect: 1, ..Step::default() }),
            sort: SortSteps::new(table, settings.classes()),
            by_screen,
            bounces,
        }
    }
}
