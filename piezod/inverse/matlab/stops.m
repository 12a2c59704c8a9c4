
% ---- hysteresis: a sum of stops, on a memory of positions ----

function s = relaxed(c)
s = new_memory(c);
s.value(1, 1, :) = 1;
for input = c.start
  s = commit(c, locate(c, s, input), input);
end
end

function [drive_v, s] = step(c, s, position_um)
[crept, s] = creep(c, s, s.last);
[x, s] = requested(c, s, position_um, crept);
x = clamped(x, s.command);
s = locate(c, s, x);
p = plays(c, s, x);
drive_v = volts(c, x + sum(c.factor .* (x - p)));
s = commit(c, s, x);
end

function p = plays(c, s, x)
% All plays in the loop of an input, the right ones first.
top = reshape(s.value(1, s.count(1), :), 1, []);
bottom = reshape(s.value(2, s.count(2), :), 1, []);
high = s.level(1, s.count(1));
low = s.level(2, s.count(2));
r = c.threshold;
right = 1:c.order;
left = c.order + right;
if s.rising
  p = bottom + (top - bottom) * ((x - low) / (high - low));
  p(right) = max((x - r(right)) ./ (1 - r(right)), bottom(right));
else
  p = top - (top - bottom) * ((high - x) / (high - low));
  p(left) = min(x ./ (1 - r(left)), top(left));
end
end

function s = store(c, s, row)
n = s.count(row) + 1;
s.value(row, n, :) = plays(c, s, s.last);
s.level(row, n) = s.last;
s.count(row) = n;
end
