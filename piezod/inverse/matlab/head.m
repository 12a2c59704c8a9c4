function [drive_v, state] = inverse(position_um, state)
% $title
%
% The inverse of the hysteresis of a piezo stage: positions in um -> voltages in V.
% Written by piezod $version from $file: $operators, fitted to $source.
%
%   drive_v = inverse(position_um)                 from rest, at $rest_v V; one sample every 1/$rate_hz s
%   [drive_v, state] = inverse(position_um, state)  goes on from a state
%   inverse('self-test')                           compares with the voltages of piezod
%
% Positions count from rest. One outside $low_um to $high_um um counts as the nearest, NaN as the one
% before; the voltage stays within $low_v to $high_v V. There is no limit of the slew rate.
% A voltage shows $lookahead_s s after its sample: give the position of that instant.
% $mode
if ischar(position_um)
  drive_v = self_test();
  return
end
c = constants();
if nargin < 2
  state = relaxed(c);
end
drive_v = zeros(size(position_um));
for k = 1:numel(position_um)
  [drive_v(k), state] = step(c, state, position_um(k));
end
end
