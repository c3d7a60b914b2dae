// One unit of a Modbus server: its tables, and what it answers to a PDU. A line, broadcasts and counters are in server.mjs.

import { Refused, fromBig, parseBits, parseRegisters, showBits, showRegisters } from '../hex.mjs';
import { decodePdu, encodePdu, functionOf } from '../modbus/pdu.mjs';
import { identify } from './identification.mjs';

export class Exception extends Error {
  constructor(code) {
    super(`exception ${code}`);
    this.code = code;
  }
}

const [FUNCTION, ADDRESS, VALUE] = [1, 2, 3];
const BITS = ['coils', 'discrete_inputs'];
const TABLES = [...BITS, 'holding_registers', 'input_registers'];
const SERIAL = ['08', '0B', '0C'];
const FUNCTIONS = ['01', '02', '03', '04', '05', '06', '07', '0F', '10', '11', '14', '15', '16', '17', '18', '2B 0E'];

/** Rows of values: first address -> bits or registers. Addresses that are in no row do not exist. */
class Table {
  constructor(name, rows, readOnly, faults) {
    this.bits = BITS.includes(name);
    const parse = this.bits ? parseBits : parseRegisters;
    this.rows = Object.entries(rows).map(([first, row]) => ({ first: Number(first), values: parse(row) }));
    this.readOnly = new Set(readOnly);
    this.faults = faults;
  }

  cell(address) {
    const row = this.rows.find(({ first, values }) => address >= first && address < first + values.length);
    if (!row) throw new Exception(ADDRESS);
    return { values: row.values, at: address - row.first };
  }

  /** The cells of so many addresses: first whether they exist, then whether the device gives them. */
  cells(address, count, writing = false) {
    const cells = Array.from({ length: count }, (_, k) => this.cell(address + k));
    for (let k = 0; k < count; k += 1) if (writing && this.readOnly.has(address + k)) throw new Exception(ADDRESS);
    const fault = this.faults.find((one) => one.address >= address && one.address < address + count);
    if (fault) throw new Exception(fault.exception);
    return cells;
  }

  read(address, count) {
    return this.cells(address, count).map(({ values, at }) => values[at]);
  }

  write(address, row) {
    this.cells(address, row.length, true).forEach(({ values, at }, k) => (values[at] = row[k]));
  }

  show() {
    const show = this.bits ? showBits : showRegisters;
    return Object.fromEntries(this.rows.map(({ first, values }) => [first, show(values)]));
  }
}

export class Unit {
  constructor(settings, line) {
    this.settings = settings;
    this.functions = (settings.functions ?? [...FUNCTIONS, ...(line === 'tcp' ? [] : SERIAL)]).map((one) => one.replace('/', ' '));
    this.tables = {};
    for (const name of TABLES) {
      const faults = (settings.faults ?? []).filter(({ table }) => table === name);
      this.tables[name] = new Table(name, settings[name] ?? {}, settings.read_only?.[name], faults);
    }
    this.files = {};
    for (const [file, row] of Object.entries(settings.files ?? {})) this.files[file] = parseRegisters(row);
  }

  /** The PDU of the answer, an exception response too. `diagnose` carries out 08, 0B and 0C, which a line knows. */
  answer(pdu, diagnose = () => {}) {
    try {
      return this.carryOut(pdu, diagnose);
    } catch (error) {
      if (error instanceof Exception) return [pdu[0] | 0x80, error.code];
      throw error;
    }
  }

  carryOut(pdu, diagnose) {
    const code = functionOf(pdu);
    if (!this.functions.includes(code)) throw new Exception(FUNCTION);
    if (SERIAL.includes(code)) return diagnose(code, pdu);
    if (code === '14' || code === '15') return code === '14' ? this.readFiles(pdu) : this.writeFiles(pdu);
    const message = this.understand(pdu);
    const fields = SERVICES[code].call(this, message);
    return fields === null ? pdu : encodePdu('response', code, fields);
  }

  understand(pdu) {
    try {
      return decodePdu('request', pdu).message;
    } catch (error) {
      if (error instanceof Refused) throw new Exception(VALUE);
      throw error;
    }
  }

  // ---------------------------------------------------------------------------------------------- files: 14 and 15

  /** A place in a file, checked: 02 for whatever is wrong with it. */
  place(group) {
    const [file, record, count] = [1, 3, 5].map((at) => fromBig(group.slice(at, at + 2)));
    const registers = this.files[file];
    const exists = group[0] === 6 && file > 0 && record <= 9999 && registers && count > 0;
    return { registers, record, count, wrong: !exists || record + count > registers.length };
  }

  readFiles(pdu) {
    const groups = this.counted(pdu, 7, 0xf5);
    if (groups.length % 7) throw new Exception(VALUE);
    const places = Array.from({ length: groups.length / 7 }, (_, k) => this.place(groups.slice(7 * k, 7 * k + 7)));
    if (places.reduce((sum, { count }) => sum + 2 + 2 * count, 0) > 251) throw new Exception(VALUE);
    if (places.some(({ wrong }) => wrong)) throw new Exception(ADDRESS);
    const records = places.map(({ registers, record, count }) => showRegisters(registers.slice(record, record + count)));
    return encodePdu('response', '14', { records });
  }

  writeFiles(pdu) {
    const groups = this.counted(pdu, 9, 0xfb);
    const writes = [];
    for (let at = 0; at < groups.length; ) {
      const place = this.place(groups.slice(at));
      const data = groups.slice(at + 7, at + 7 + 2 * place.count);
      if (at + 7 > groups.length || data.length < 2 * place.count) throw new Exception(VALUE);
      writes.push({ ...place, data });
      at += 7 + data.length;
    }
    if (writes.some(({ wrong }) => wrong)) throw new Exception(ADDRESS);
    for (const { registers, record, count, data } of writes) {
      for (let k = 0; k < count; k += 1) registers[record + k] = fromBig(data.slice(2 * k, 2 * k + 2));
    }
    return pdu;
  }

  counted(pdu, low, high) {
    const data = pdu.slice(2);
    if (data.length !== pdu[1] || data.length < low || data.length > high) throw new Exception(VALUE);
    return data;
  }

  // ----------------------------------------------------------------------------------------------------- the others

  show() {
    const shown = {};
    for (const name of TABLES) shown[name] = this.tables[name].show();
    shown.files = Object.fromEntries(Object.entries(this.files).map(([file, row]) => [file, showRegisters(row)]));
    if (this.settings.queues) shown.queues = this.settings.queues;
    return shown;
  }
}

/** What each function does with the fields of its request; null: the answer is the request once more. */
const readBits = (table) =>
  function read({ address, quantity }) {
    return { bits: showBits(this.tables[table].read(address, quantity)) };
  };
const readRegisters = (table) =>
  function read({ address, quantity }) {
    return { registers: showRegisters(this.tables[table].read(address, quantity)) };
  };

const SERVICES = {
  '01': readBits('coils'),
  '02': readBits('discrete_inputs'),
  '03': readRegisters('holding_registers'),
  '04': readRegisters('input_registers'),
  '05'({ address, value }) {
    this.tables.coils.write(address, [value ? 1 : 0]);
    return null;
  },
  '06'({ address, value }) {
    this.tables.holding_registers.write(address, [value]);
    return null;
  },
  '07'() {
    return { status: parseInt(this.settings.exception_status ?? '00', 16) };
  },
  '0F'({ address, bits }) {
    const row = parseBits(bits);
    this.tables.coils.write(address, row);
    return { address, quantity: row.length };
  },
  10({ address, registers }) {
    const row = parseRegisters(registers);
    this.tables.holding_registers.write(address, row);
    return { address, quantity: row.length };
  },
  11() {
    return { data: this.settings.server_id ?? '' };
  },
  16({ address, and_mask: and, or_mask: or }) {
    const [old] = this.tables.holding_registers.read(address, 1);
    this.tables.holding_registers.write(address, [(old & and) | (or & ~and & 0xffff)]);
    return null;
  },
  17(message) {
    const table = this.tables.holding_registers;
    table.cells(message.read_address, message.read_quantity);
    table.write(message.write_address, parseRegisters(message.registers));
    return { registers: showRegisters(table.read(message.read_address, message.read_quantity)) };
  },
  18({ address }) {
    const queue = this.settings.queues?.[address];
    if (queue === undefined) throw new Exception(ADDRESS);
    if (parseRegisters(queue).length > 31) throw new Exception(VALUE);
    return { registers: queue };
  },
  '2B 0E'({ read_code: code, object_id: first }) {
    const answer = identify(this.settings.identification ?? {}, code, first);
    if (!answer) throw new Exception(ADDRESS);
    return answer;
  },
};
