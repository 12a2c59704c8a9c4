
% ---- hysteresis: a surface of loops, on a memory of voltages ----

function s = relaxed(c)
s = new_memory(c);
s.value(1, 1, 1) = surface(c, 1, 0);
s.now = 0;
for seen = c.start
  s = see(c, s, seen);
end
s.pinned = c.start_pinned;
s.change = c.start_change;
s.raw = c.start_next;
s.next = c.start_next;
end

function [drive_v, s] = step(c, s, position_um)
s = advance(c, s, s.next);
[crept, s] = creep(c, s, s.now + beside_now(c, s));
[position, s] = requested(c, s, position_um, crept);
if c.fast == 0                                    % loops that close stay within 0 to 1
  position = clamped(position, s.command);
end
z = lagging_for(c, s, position);
s.next = clamped(z + behind(c, s, z), 0);
drive_v = volts(c, s.next);
end

function s = store(c, s, row)                     %#ok<INUSL>
n = s.count(row) + 1;
s.value(row, n, 1) = s.now;
s.level(row, n) = s.last;
s.count(row) = n;
end

function s = advance(c, s, drive)
s.raw = clamped(drive, s.raw);
seen = lagging(c, s, s.raw);
s = see(c, s, seen);
if c.fast ~= 0
  s.change = path(c, s, seen);
  s.pinned = min(max(s.pinned, seen - 1e-4), seen + 1e-4);
end
end

function s = see(c, s, seen)
s = locate(c, s, seen);
if s.rising
  s.now = s.value(2, s.count(2), 1) + surface(c, seen, s.level(2, s.count(2)));
else
  s.now = s.value(1, s.count(1), 1) - surface(c, s.level(1, s.count(1)), seen);
end
s = commit(c, s, seen);
end

function [move, rising, falling] = surface(c, upper, lower)
width = max(upper - lower, 0);
x = 2 * sqrt(width) - 1;
y = upper + lower - 1;
[p, d] = legendre_5(x);
[q, e] = legendre_5(y);
level = c.coefficient * q(1:4)';
common = (p + sqrt(width) * d) * level;
skew = width * (p * (c.coefficient * e(1:4)'));
move = width * (p * level);
rising = common + skew;
falling = common - skew;
end

function [p, d] = legendre_5(x)
p = [1, x, 0, 0, 0, 0];
d = [0, 1, 0, 0, 0, 0];
for n = 2:5
  p(n + 1) = ((2 * n - 1) * x * p(n) - (n - 1) * p(n - 1)) / n;
  d(n + 1) = (2 * n - 1) * p(n) + d(n - 1);
end
end

function lag = behind(c, s, z)
lag = 0;
if c.activation ~= 0
  lag = c.activation * asinh((z - s.last) / c.advance);
end
end

function z = lagging(c, s, drive)
z = drive;
if c.activation == 0
  return
end
move = abs(drive - s.last);
a = min(move / c.activation, asinh(move / c.advance));
for i = 1:20
  change = (c.advance * sinh(a) + c.activation * a - move) / (c.advance * cosh(a) + c.activation);
  a = a - change;
  if abs(change) <= 1e-15 * a
    break
  end
end
moved = min(c.advance * sinh(a), move);
z = s.last + moved * (2 * (drive > s.last) - 1);
end

function [change, slope] = path(c, s, drive)
change = 0;
slope = 0;
if c.fast == 0
  return
end
change = s.change;
move = drive - s.pinned;
if abs(move) <= 1e-4
  return
end
direction = 2 * (move > 0) - 1;
h = risen(c, direction * (s.change + c.at_rest), abs(move) - 1e-4);
change = direction * h - c.at_rest;
slope = rise_slope(c, h);
end

function slope = rise_slope(c, h)
relaxed = h * c.fast;
if h < 0
  relaxed = h * c.slow;
end
if c.exponent ~= 1
  relaxed = relaxed * (c.fast * abs(h)) ^ (c.exponent - 1);
end
slope = 1 - relaxed;
end

function h = stepped(c, h, part)                  % by the method of Runge and Kutta
k1 = rise_slope(c, h);
k2 = rise_slope(c, h + 0.5 * part * k1);
k3 = rise_slope(c, h + 0.5 * part * k2);
k4 = rise_slope(c, h + part * k3);
h = h + part * (k1 + 2 * k2 + 2 * k3 + k4) / 6;
end

function h = risen(c, h, rise)
if c.exponent ~= 1
  part = 1 / (16 * max(c.fast, c.slow));          % whole steps, then the rest
  whole = floor(rise / part);
  for i = 1:whole
    h = stepped(c, h, part);
  end
  h = stepped(c, h, rise - whole * part);
  return
end
if h < 0
  to_zero = log1p(-h * c.slow) / c.slow;
  if rise <= to_zero
    h = 1 / c.slow + (h - 1 / c.slow) * exp(-c.slow * rise);
    return
  end
  rise = rise - to_zero;
  h = 0;
end
h = 1 / c.fast + (h - 1 / c.fast) * exp(-c.fast * rise);
end

function [displacement, slope] = beside(c, s, z)
[change, relaxing] = path(c, s, z);
displacement = c.prompt * behind(c, s, z) + c.weight * change;
slope = c.weight * relaxing;
if c.activation ~= 0
  slope = slope + c.prompt * c.activation / hypot(z - s.last, c.advance);
end
end

function displacement = beside_now(c, s)
displacement = c.prompt * (s.raw - s.last) + c.weight * s.change;
end

function displacement = at(c, s, row, place)
displacement = s.value(row, place, 1) + beside(c, s, s.level(row, place));
end

function z = lagging_for(c, s, position)
now = s.now + c.weight * s.change;
guess = s.last + position - s.now - beside_now(c, s);
count = s.count;
start = s.last;
at_start = s.now;
low = s.last;
high = s.last;
z = s.last;
if position > now
  inside = ~s.rising;                             % the last drive would become a minimum
  count(2) = count(2) + inside;
  while count(1) > 1 && position >= at(c, s, 1, count(1))
    low = s.level(1, count(1));
    count = count - 1;
  end
  high = s.level(1, count(1));
  if position >= at(c, s, 1, count(1))
    z = high;
    return
  end
  if ~inside || count(2) <= s.count(2)
    start = s.level(2, count(2));
    at_start = s.value(2, count(2), 1);
  end
  z = solved(c, s, start, position - at_start, low, high, guess);
elseif position < now
  inside = s.rising;                              % the last drive would become a maximum
  count(1) = count(1) + inside;
  while count(2) > 1 && position <= at(c, s, 2, count(2))
    high = s.level(2, count(2));
    count = count - 1;
  end
  low = s.level(2, count(2));
  if position <= at(c, s, 2, count(2))
    z = low;
    return
  end
  if ~inside || count(1) <= s.count(1)
    start = s.level(1, count(1));
    at_start = s.value(1, count(1), 1);
  end
  z = solved(c, s, start, at_start - position, low, high, guess);
end
end

function drive = solved(c, s, start, rise, low, high, guess)
% The end of a branch, by Newton's method, or by bisection where a step would leave the bracket.
rising = start <= low;
drive = guess;
if ~(low < guess && guess < high)
  drive = 0.5 * (low + high);
end
for i = 1:60
  [added, slope] = beside(c, s, drive);
  if rising
    [move, own, ~] = surface(c, drive, start);
    miss = move + added - rise;
  else
    [move, ~, own] = surface(c, start, drive);
    miss = rise - move + added;
  end
  if abs(miss) < 1e-14
    break
  end
  if miss > 0
    high = drive;
  else
    low = drive;
  end
  drive = drive - miss / (own + slope);
  if ~(low < drive && drive < high)
    drive = 0.5 * (low + high);
  end
end
end
