// Drives a design with one stream on either side. ports.h names the design's ports.
#include "harness.h"

namespace {

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

struct Simulator {
    Design top;
    Stalls source{0, 0}, sink{0, 0};
    bool offering = false;
    int64_t idle = 0;
    int64_t cycle = 0;
};

// A buffer of records of wires inside the design.
struct Watched {
    uint64_t *records;
    int64_t words, room, count;
    uint64_t *next(bool enable) {
        if (!enable) return nullptr;
        return count < room ? records + words * count++ : (count++, nullptr);
    }
};

enum Status { DONE, MORE, STUCK, UNSETTLED };

}  // namespace

EXPORT Simulator *simulator_create() {
    Simulator *simulator = new Simulator;
    Design &top = simulator->top;
    top.CLOCK.data[0] = 1;
    top.RESET.data[0] = 1;
    for (int i = 0; i < 4; i++) {
        evaluate(top);
        top.commit();
    }
    top.RESET.data[0] = 0;
    return simulator;
}

EXPORT void simulator_destroy(Simulator *simulator) { delete simulator; }

EXPORT void simulator_stall(Simulator *simulator, uint64_t seed, uint64_t source, uint64_t sink) {
    simulator->source = {seed, source};
    simulator->sink = {~seed, sink};
}

// Runs until `tokens` are accepted and `results` are produced, or `budget` cycles have passed, or nothing
// has moved for `patience` cycles. `counts` = {accepted, produced, cycle}, kept from call to call.
EXPORT int simulator_run(Simulator *simulator, const uint64_t *in, int64_t tokens, uint64_t *out,
                         int64_t results, int64_t *accepted_at, int64_t *produced_at, int64_t *counts,
                         Watched *watched, int64_t budget, int64_t patience) {
    Design &top = simulator->top;
    int64_t accepted = counts[0], produced = counts[1], idle = simulator->idle;
    bool offering = simulator->offering;
    Status status = DONE;
    while (accepted < tokens || produced < results) {
        if (budget-- <= 0) { status = MORE; break; }
        // An offer once made stands until it is accepted.
        if (!offering && accepted < tokens && !simulator->source.draw()) {
            offering = true;
            const uint64_t *words = in + accepted * IN_WORDS;
            PUT_INPUTS(top, words)
        }
        bool taking = produced < results && !simulator->sink.draw();
        top.IN_VALID.data[0] = offering;
        top.OUT_READY.data[0] = taking;
        if (!evaluate(top)) { status = UNSETTLED; break; }
        WATCH(top, watched)
        bool moved = false;
        if (offering && bit(top.IN_READY)) {
            accepted_at[accepted++] = simulator->cycle;
            offering = false;
            moved = true;
        }
        if (taking && bit(top.OUT_VALID)) {
            uint64_t *words = out + produced * OUT_WORDS;
            GET_OUTPUTS(top, words)
            produced_at[produced++] = simulator->cycle;
            moved = true;
        }
        top.commit();
        simulator->cycle++;
        idle = moved ? 0 : idle + 1;
        if (idle >= patience) { status = STUCK; break; }
    }
    simulator->offering = offering;
    simulator->idle = status == MORE ? idle : 0;
    counts[0] = accepted;
    counts[1] = produced;
    counts[2] = simulator->cycle;
    return status;
}
