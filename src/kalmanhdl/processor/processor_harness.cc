// Drives the processor: loads a program, then plays the peripherals at its handshakes, clock by clock, and
// records what every instruction does. The peripherals are those of peripherals.py.
#include "harness.h"

namespace {

int64_t word(const value<WORD_BITS> &port) { return int64_t(uint64_t(port.data[0]) << (64 - WORD_BITS)) >> (64 - WORD_BITS); }

template <size_t Bits>
uint64_t number(const value<Bits> &port) { return port.data[0]; }
template <size_t Bits>
uint64_t number(const wire<Bits> &port) { return port.curr.data[0]; }

template <size_t Bits>
bool any(const value<Bits> &port) {
    for (auto chunk : port.data)
        if (chunk) return true;
    return false;
}
template <size_t Bits>
bool any(const wire<Bits> &port) { return any(port.curr); }

// A bench has no latencies: it knows the program, and has the next number ready at every READ.
struct Source {
    const int64_t *tokens = nullptr, *latencies = nullptr, *reactions = nullptr;
    int64_t count = 0, next = 0, wait = 0, data = 0;
    bool ready = false, dropping = false, before = false;

    void start() {
        if (!latencies) {
            next = -1;
            read();
        } else if (count) {
            wait = latencies[0];
        }
    }
    void read() {
        if (latencies) return;
        next++;
        ready = next < count;
        data = ready ? tokens[next] : count ? ~tokens[count - 1] : 0;
    }
    void clock(bool acknowledged) {
        if (!latencies) return;
        bool rise = acknowledged && !before;
        before = acknowledged;
        if (ready) {
            if (rise && !dropping) {
                dropping = true;
                wait = reactions[next];
            }
            if (!dropping) return;
            if (wait) {
                wait--;
                return;
            }
            ready = dropping = false;
            data = ~data;
            next++;
            wait = next < count ? latencies[next] : 0;
        } else if (next < count) {
            if (wait) {
                wait--;
            } else {
                ready = true;
                data = tokens[next];
            }
        }
    }
};

// A bench has no latencies: it takes every number at once.
struct Sink {
    const int64_t *latencies = nullptr, *reactions = nullptr;
    int64_t count = 0, next = 0, wait = 0;
    bool taken = true, reacting = false, before = false;

    void clock(bool ready) {
        if (!latencies) return;
        bool rise = ready && !before;
        before = ready;
        if (taken) {
            if (rise && !reacting) {
                reacting = true;
                wait = reactions[next];
            }
            if (!reacting) return;
            if (wait) {
                wait--;
                return;
            }
            taken = reacting = false;
            wait = latencies[next];
        } else if (wait) {
            wait--;
        } else {
            taken = true;
            next = (next + 1) % count;
        }
    }
};

struct Simulator {
    Design top;
    Source source;
    Sink sink;
    int64_t cycle = 0;
};

void clock(Simulator &simulator) {
    evaluate(simulator.top);
    simulator.top.commit();
}

}  // namespace

EXPORT Simulator *simulator_create() {
    Simulator *simulator = new Simulator;
    simulator->top.CLOCK.data[0] = 1;
    return simulator;
}

EXPORT void simulator_destroy(Simulator *simulator) { delete simulator; }

// A reset, then the program; returns the clocks from the end of the reset until the program runs, or -1 where
// it does not within `patience` clocks.
EXPORT int64_t simulator_load(Simulator *simulator, const uint32_t *words, int64_t count, int64_t patience) {
    Design &top = simulator->top;
    top.RESET.data[0] = 1;
    // The peripherals of the last program are gone.
    top.DATA_READY.data[0] = 0;
    for (int i = 0; i < 2; i++) clock(*simulator);
    top.RESET.data[0] = 0;
    simulator->cycle = 0;
    int64_t next = 0;
    for (int64_t clocks = 0; clocks < patience; clocks++) {
        bool offering = next < count;
        top.PROGRAM_VALID.data[0] = offering;
        top.PROGRAM_WORD.data[0] = offering ? words[next] : 0xffffffffu;
        top.PROGRAM_LAST.data[0] = next == count - 1;
        evaluate(top);
        if (bit(top.RUNNING)) {
            // This clock is the first of the program; it has not been committed.
            top.PROGRAM_VALID.data[0] = 0;
            return clocks;
        }
        if (offering && bit(top.PROGRAM_READY)) next++;
        top.commit();
    }
    return -1;
}

EXPORT void simulator_attach(Simulator *simulator, const int64_t *tokens, const int64_t *latencies,
                             const int64_t *reactions, int64_t count, const int64_t *sink_latencies,
                             const int64_t *sink_reactions, int64_t sink_count) {
    simulator->source = {tokens, latencies, reactions, count};
    simulator->source.start();
    simulator->sink = {sink_latencies, sink_reactions, sink_count};
}

// Runs until `instructions` have taken effect, or for `patience` clocks without one; returns how many records were
// made. A record of every clock in which one does, or a result is stored: clock, addresses and flags, data_out, then
// what is stored.
EXPORT int64_t simulator_run(Simulator *simulator, uint64_t *records, int64_t instructions, int64_t patience) {
    Design &top = simulator->top;
    Source &source = simulator->source;
    Sink &sink = simulator->sink;
    int64_t done = 0, idle = 0, made = 0;
    while (done < instructions && idle < patience) {
        top.DATA_READY.data[0] = source.ready;
        top.DATA_IN.data[0] = uint32_t(source.data) & value<WORD_BITS>::msb_mask;
        top.OUTPUT_TAKEN.data[0] = sink.taken;
        evaluate(top);
        bool acknowledged = bit(top.ACKNOWLEDGE), offered = bit(top.OUTPUT_READY), issued = bit(top.ISSUED);
        bool read = issued && number(top.OPCODE) == READ_OPCODE;
        bool stored = any(top.STORED);
        if (issued || stored) {
            uint64_t *record = records + RECORD_WORDS * made++;
            record[0] = simulator->cycle;
            record[1] = number(top.ADDRESS) | number(top.MATRIX) << 16 | uint64_t(acknowledged) << 32 |
                        uint64_t(offered) << 33 | uint64_t(source.ready) << 34 | uint64_t(sink.taken) << 35 |
                        uint64_t(bit(top.SATURATED)) << 36 | uint64_t(issued) << 37;
            GET_RECORD(top, record)
            done += issued;
        }
        source.clock(acknowledged);
        sink.clock(offered);
        if (read) source.read();
        top.commit();
        simulator->cycle++;
        idle = issued ? 0 : idle + 1;
    }
    return made;
}
