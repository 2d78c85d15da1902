// Drives a design with streams. model.h wraps the simulator, pairs.h names the design's ports.
#include <algorithm>
#include <cstdint>
#include <utility>
#include "model.h"

namespace {

// A buffer of records of wires inside the design.
struct Watched {
    uint64_t *records;
    int64_t words, room, count;
    uint64_t *next(bool enable) {
        if (!enable) return nullptr;
        return count < room ? records + words * count++ : (count++, nullptr);
    }
};

#include "pairs.h"

// SplitMix64: any seed is good, and two streams of one seed differ by a constant.
struct Stalls {
    uint64_t state;
    uint64_t threshold;
    bool draw() {
        if (threshold == 0) return false;
        uint64_t z = (state += 0x9e3779b97f4a7c15u);
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
        return (z ^ (z >> 31)) < threshold;
    }
};

// What goes through one stream in and one stream out in a call; accepted and produced count up.
struct Flow {
    const uint64_t *in;
    uint64_t *out;
    int64_t *accepted_at, *produced_at;
    int64_t tokens, results, accepted, produced;
    bool ended() const { return accepted >= tokens && produced >= results; }
};

struct Ends {
    Stalls source{0, 0}, sink{0, 0};
    bool offering = false, taking = false;
};

struct Simulator {
    Model model;
    Ends ends[PAIRS];
    int64_t idle = 0;
    int64_t cycle = 0;
};

enum Status { DONE, MORE, STUCK, UNSETTLED };

template <size_t k>
void drive(Simulator &simulator, const Flow &flow) {
    Ends &ends = simulator.ends[k];
    // An offer once made stands until it is accepted.
    if (!ends.offering && flow.accepted < flow.tokens && !ends.source.draw()) {
        ends.offering = true;
        Pair<k>::send(simulator.model, flow.in + flow.accepted * Pair<k>::in_words);
    }
    ends.taking = flow.produced < flow.results && !ends.sink.draw();
    Pair<k>::offer(simulator.model, ends.offering);
    Pair<k>::take(simulator.model, ends.taking);
}

template <size_t k>
bool look(Simulator &simulator, Flow &flow) {
    Ends &ends = simulator.ends[k];
    bool moved = false;
    if (ends.offering && Pair<k>::accepted(simulator.model)) {
        flow.accepted_at[flow.accepted++] = simulator.cycle;
        ends.offering = false;
        moved = true;
    }
    if (ends.taking && Pair<k>::offered(simulator.model)) {
        Pair<k>::receive(simulator.model, flow.out + flow.produced * Pair<k>::out_words);
        flow.produced_at[flow.produced++] = simulator.cycle;
        moved = true;
    }
    return moved;
}

template <size_t... k>
Status run(Simulator &simulator, Flow *flows, Watched *watched, int64_t budget, int64_t patience,
           std::index_sequence<k...>) {
    Model &model = simulator.model;
    while (!(flows[k].ended() && ...)) {
        if (budget-- <= 0) return MORE;
        (drive<k>(simulator, flows[k]), ...);
        if (!model.settle()) return UNSETTLED;
        watch(model, watched);
        bool moved = (look<k>(simulator, flows[k]) | ...);
        model.edge();
        simulator.cycle++;
        simulator.idle = moved ? 0 : simulator.idle + 1;
        if (simulator.idle >= patience) return STUCK;
    }
    return DONE;
}

}  // namespace

EXPORT Simulator *simulator_create() {
    Simulator *simulator = new Simulator;
    Model &model = simulator->model;
    reset(model, true);
    for (int i = 0; i < 4; i++) {
        model.settle();
        model.edge();
    }
    reset(model, false);
    return simulator;
}

EXPORT void simulator_destroy(Simulator *simulator) { delete simulator; }

EXPORT void simulator_stall(Simulator *simulator, uint64_t seed, uint64_t source, uint64_t sink) {
    for (Ends &ends : simulator->ends) {
        ends.source = {seed, source};
        ends.sink = {~seed, sink};
        seed += 0x5851f42d4c957f2du;
    }
    // A token may have been a reset.
    reset(simulator->model, false);
}

// Runs until all tokens are accepted and all results produced, or `budget` cycles have passed, or nothing
// has moved for `patience` cycles; `cycle` is how many there were since the reset.
EXPORT int simulator_run(Simulator *simulator, Flow *flows, Watched *watched, int64_t *cycle, int64_t budget,
                         int64_t patience) {
    Status status = run(*simulator, flows, watched, budget, patience, std::make_index_sequence<PAIRS>());
    if (status != MORE) simulator->idle = 0;
    *cycle = simulator->cycle;
    return status;
}
