% The dung beetle in Octave: one JSON object a line on standard input, one command a line on standard output.
addpath(fileparts(mfilename('fullpath')));
sigterm_dumps_octave_core(false); % when it is ended from outside, it leaves no file behind

while true
  try
    line = input('', 's'); % not fgetl, which on a pipe waits for the first byte of the next line, too
  catch
    break % the end of the stream is the end of the run
  end
  message = jsondecode(line);
  switch message.message
    case 'Briefing'
      beetle = beetle_new(message, exact_number(line, 'search_height_m'));
    case 'Observation'
      if message.awaiting_command
        [beetle, goal_m] = beetle_decide(beetle, message);
        % Not by jsonencode, which writes 15 digits; 17 keep every bit.
        printf('{"tick":%d,"kind":"waypoint","position_world_m":[%.17g,%.17g,%.17g]}\n', message.tick, goal_m);
        fflush(stdout);
      end
    case 'Ending'
      break
  end
end
