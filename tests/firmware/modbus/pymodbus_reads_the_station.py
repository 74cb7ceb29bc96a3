# A second client that nobody here wrote. Prints what it found, one fact a line; any surprise ends it with a message. pymodbus 3.0 (Debian 12)
# and 3.8 (Debian 13) take counts by name; a write and a read at once, and the identity, they spell differently.
import logging
import sys

from pymodbus.client import ModbusTcpClient

logging.disable(logging.CRITICAL)  # the later one logs a refusal that was asked for


def registers(reply, count):
    if reply.isError() or len(reply.registers) != count:
        sys.exit(f"unexpected reply: {reply}")
    return reply.registers


client = ModbusTcpClient("127.0.0.1", port=int(sys.argv[1]), timeout=20)
if not client.connect():
    sys.exit("no connection")

base = 0
while True:
    block, length = registers(client.read_holding_registers(base, count=2, slave=1), 2)
    print(f"block {block} at {base}")
    if block == 0xFFFF:
        break
    base += 2 + length

holding = registers(client.read_holding_registers(100, count=40, slave=1), 40)
inputs = registers(client.read_input_registers(100, count=40, slave=1), 40)
print("mirrored" if holding == inputs else "not mirrored")
print(f"state {holding[2]}")
print("bits", "".join("1" if b else "0" for b in client.read_discrete_inputs(0, count=8, slave=1).bits[:8]))

refused = client.read_holding_registers(400, count=1, slave=1)
print("exception", refused.exception_code if refused.isError() else "none")

written = client.write_registers(8002, [0, 71, 0, 2], slave=1)
print("command", "failed" if written.isError() else "written")
print("reply", registers(client.read_holding_registers(8022, count=5, slave=1), 5))
client.write_registers(8002, [0, 71, 0, 2], slave=1)
later = hasattr(client, "read_device_information")
both = client.readwrite_registers(read_address=8022, read_count=5, write_address=8002, slave=1, **{"values" if later else "write_registers": [0, 72, 0, 6]})
print("reply", registers(both, 5))
client.write_register(8102, 5, slave=1)
client.mask_write_register(address=8102, and_mask=0xFFFD, or_mask=0x0002, slave=1)  # 5 & 0xFFFD | 2 = 7
print("heartbeat", registers(client.read_holding_registers(8102, count=1, slave=1), 1)[0])
client.write_coil(80, True, slave=1)
print("heartbeat", registers(client.read_holding_registers(8102, count=1, slave=1), 1)[0])

if later:
    identity = client.read_device_information(read_code=1, slave=1)
else:
    from pymodbus.mei_message import ReadDeviceInformationRequest

    identity = client.execute(ReadDeviceInformationRequest(read_code=1, unit=1))
print("identity", identity.information[1].decode(), identity.information[2].decode())
client.close()
