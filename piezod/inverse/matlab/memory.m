
% ---- memory: the turning points that still count; the outermost ones come first ----

function s = new_memory(c)
s.level = zeros(2, c.extrema + 1);                % row 1: maxima, row 2: minima
s.value = zeros(2, c.extrema + 1, c.width);
s.level(1, 1) = 1;
s.count = [1 1];
s.rising = true;
s.last = 0;
s.merged = 0;
s.command = c.start_command;
s.lag = c.lag_start;
end

function y = clamped(value, fallback)
y = fallback;                                     % NaN
if value >= 1
  y = 1;
elseif value >= 0
  y = value;
elseif value < 0
  y = 0;
end
end

function s = locate(c, s, input)
% Find the loop of an input. One that reaches a turning point deletes the loop inside it.
if input > s.last
  if ~s.rising
    s = store(c, s, 2);
  end
  while s.count(1) > 1 && input >= s.level(1, s.count(1))
    s.count = s.count - 1;
  end
  s.rising = true;
elseif input < s.last
  if s.rising
    s = store(c, s, 1);
  end
  while s.count(2) > 1 && input <= s.level(2, s.count(2))
    s.count = s.count - 1;
  end
  s.rising = false;
end
end

function s = commit(c, s, input)
s.last = input;
if max(s.count) > c.extrema
  s = merge(s);
end
end

function s = merge(s)
% A full memory loses the pair of neighbours whose longer side is the shortest.
shortest = 2;
at = [1 1];
for i = 2:s.count(2) - 1
  drop = s.level(1, i) - s.level(1, i + 1);
  side = max(drop, s.level(2, i) - s.level(2, i - 1));
  if side < shortest
    shortest = side;
    at = [i i];
  end
  side = max(drop, s.level(2, i + 1) - s.level(2, i));
  if side < shortest
    shortest = side;
    at = [i + 1, i];
  end
end
for row = 1:2
  n = s.count(row);
  s.level(row, at(row):n - 1) = s.level(row, at(row) + 1:n);
  s.value(row, at(row):n - 1, :) = s.value(row, at(row) + 1:n, :);
end
s.count = s.count - 1;
s.merged = s.merged + 1;
end

function [crept, s] = creep(c, s, before)
crept = 0;
for k = 1:numel(s.lag)
  s.lag(k) = s.lag(k) + c.lag_gain(k) * (before - s.lag(k));
  crept = crept + c.lag_weight(k) * s.lag(k);
end
end

function [position, s] = requested(c, s, position_um, crept)
unit = (position_um - c.position_low_um) / (c.position_high_um - c.position_low_um);
s.command = clamped(unit, s.command);
position = s.command + c.zeroed - crept;
end

function drive_v = volts(c, drive)
drive_v = c.drive_low_v + clamped(drive, 0) * (c.drive_high_v - c.drive_low_v);
end

function worst = self_test()
% Sines, decays, noise, NaN and a full memory.
[position_um, expected_v, drive_range_v] = vectors();
drive_v = inverse(position_um);
worst = max(abs(drive_v - expected_v)) / drive_range_v;
if ~(worst <= 1e-12)
  error('FAILED: worst difference %.3g of the range, allowed 1e-12', worst);
end
fprintf('passed: worst difference %.3g of the range, allowed 1e-12\n', worst);
end
