% $about
%
% Run this script: it leaves ${name}_amplitudes, ${name}_times (s), ${name}_b and ${name}_a in the workspace, for
%
%     shaped = filter(${name}_b, ${name}_a, command);    % command sampled every ${name}_sample_time s, from rest at 0
%
% In Simulink, a Discrete FIR Filter takes ${name}_b; a functional mock-up unit of the same filter is its other way in.

${name}_sample_time = $sample_time;
${name}_amplitudes = [$amplitudes];
${name}_times = [$times];
${name}_b = zeros(1, $length);
${name}_b([$places]) = [$taps];
${name}_a = 1;
