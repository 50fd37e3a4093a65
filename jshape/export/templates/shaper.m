% $about
%
% Run this script: it leaves ${name}_amplitudes, ${name}_times (s), ${name}_b and ${name}_a in the workspace, for
%
%     shaped = filter(${name}_b, ${name}_a, command);    % command sampled every ${name}_sample_time s, from rest at 0
%
% and, where Simulink is installed, opens a model ${name} with two subsystems to copy from: ${name}/Continuous, a
% Transport Delay an impulse, exact; ${name}/Digital, a Discrete FIR Filter.

${name}_sample_time = $sample_time;
${name}_amplitudes = [$amplitudes];
${name}_times = [$times];
${name}_b = zeros(1, $length);
${name}_b([$places]) = [$taps];
${name}_a = 1;

if exist('new_system') && exist('add_block')
    load_system('simulink');
    new_system('$name');
    open_system('$name');
    parts = {'Continuous', 'Digital'};
    for k = 1:2
        part = ['$name/' parts{k}];
        add_block('built-in/Subsystem', part, 'Position', [60 60*k 160 60*k+40]);
        add_block('built-in/Inport', [part '/Command'], 'Position', [20 33 50 47]);
        add_block('built-in/Outport', [part '/Shaped'], 'Position', [420 33 450 47]);
    end
    add_block('simulink/Discrete/Discrete FIR Filter', '$name/Digital/Taps', 'Position', [180 20 260 60], ...
        'Coefficients', '${name}_b', 'SampleTime', '${name}_sample_time');
    add_line('$name/Digital', 'Command/1', 'Taps/1');
    add_line('$name/Digital', 'Taps/1', 'Shaped/1');
    count = numel(${name}_times);
    add_block('simulink/Math Operations/Add', '$name/Continuous/Sum', 'Position', [360 20 380 20+50*count], ...
        'Inputs', repmat('+', 1, count));
    for k = 1:count
        gain = sprintf('Gain%d', k);
        delay = sprintf('Delay%d', k);
        at = [180 50*k-30 220 50*k];
        add_block('simulink/Math Operations/Gain', ['$name/Continuous/' gain], 'Position', at + [100 0 100 0], ...
            'Gain', sprintf('${name}_amplitudes(%d)', k));
        if ${name}_times(k) > 0
            add_block('simulink/Continuous/Transport Delay', ['$name/Continuous/' delay], 'Position', at, ...
                'DelayTime', sprintf('${name}_times(%d)', k));
            add_line('$name/Continuous', 'Command/1', [delay '/1']);
            add_line('$name/Continuous', [delay '/1'], [gain '/1']);
        else
            add_line('$name/Continuous', 'Command/1', [gain '/1']);
        end
        add_line('$name/Continuous', [gain '/1'], sprintf('Sum/%d', k));
    end
    add_line('$name/Continuous', 'Sum/1', 'Shaped/1');
end
