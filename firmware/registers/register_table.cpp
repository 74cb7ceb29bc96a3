// The table of all blocks by ascending address, and static checks of its layout.
#include "firmware/registers/plc_blocks.h"
#include "firmware/registers/station_blocks.h"

namespace hord::firmware {
namespace {

using namespace rows;

constexpr Block kBlocks[] = {
    {BlockId::ident, "IDENT", 0, 98, "Who this is, and which map it speaks", kIdent},
    {BlockId::status, "STATUS", 100, 38, "What the station does now", kStatus},
    {BlockId::counters, "COUNTERS", 140, 58, "Totals since the start", kCounters},
    {BlockId::last, "LAST", 200, 98, "The newest result", kResult<202>},
    {BlockId::gap, "GAP", 300, 696, "", {}},
    {BlockId::ring, "RING", kRingBase - kBlockHeader, kRingSlots* kResultWords,
     "The last 256 results: result s stands at 1000 + 24 * (s mod 256)", kResult<kRingBase>, kRingSlots, kResultWords},
    {BlockId::gap, "GAP", 7144, 854, "", {}},
    {BlockId::command, "COMMAND", 8000, 18, "One command, written in one request (FC 16 or 23) from its token on",
     kCommand},
    {BlockId::reply, "REPLY", 8020, 78, "What became of the command that was written last", kReply},
    {BlockId::plc, "PLC", 8100, 98, "The PLC's side: its heartbeat, and the results that it has taken", kPlc},
    {BlockId::recipe, "RECIPE", 8200, 98, "Limits staged for commit_recipe, and the recipe in use", kRecipe},
    {BlockId::gap, "GAP", 8300, 98, "", {}},
    {BlockId::health, "HEALTH", 8400, 98, "How well the station is", kHealth},
    {BlockId::calibration, "CALIBRATION", 8500, 98, "The lenslet grid in use", kCalibration},
    {BlockId::end, "END", 8600, 0, "End of the chain", {}},
};

constexpr bool chain_is_contiguous() {
    std::uint16_t next = 0;
    for (const Block& block : kBlocks) {
        if (block.base != next) return false;
        next = static_cast<std::uint16_t>(block.base + block.size());
    }
    return kBlocks[std::size(kBlocks) - 1].id == BlockId::end;
}
constexpr bool rows_fit() {
    for (const Block& block : kBlocks) {
        std::uint16_t next = static_cast<std::uint16_t>(block.base + kBlockHeader);
        for (const Register& row : block.registers) {
            if (row.address < next || (row.number == nullptr) == (row.text == nullptr)) return false;
            next = static_cast<std::uint16_t>(row.address + row.words);
        }
        if (next > block.base + block.size()) return false;
        if (block.slots > 0) {
            if (block.slots * block.slot_words != block.length || next != block.base + kBlockHeader + block.slot_words)
                return false;
        } else if (!block.registers.empty() && block.size() > kMaxRead) {
            return false;
        }
    }
    return true;
}
static_assert(chain_is_contiguous(), "each block's length leads to the next block");
static_assert(rows_fit(), "rows ascend, do not overlap, stay in their block; a block is one request");
static_assert(kResult<0>.back().address + kResult<0>.back().words == kResultWords);

}  // namespace

std::span<const Block> register_blocks() { return kBlocks; }

}  // namespace hord::firmware
